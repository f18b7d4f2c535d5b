# pyright: reportPrivateImportUsage=false
"""Targets: files that are put into the object store, and then named by an application's metadata."""

from dataclasses import dataclass, field
from pathlib import Path

from tuf.api.metadata import TargetFile

from ..sources import FileHashes
from .metadata import Changes, Repository
from .publishing import Publisher
from .roles import application_role, target_key


@dataclass
class TargetStep:
    """Targets of one application that are published together."""

    publisher: Publisher
    application: str
    _targets: dict[str, TargetFile] = field(default_factory=dict[str, TargetFile])

    def add_file(self, target: str, path: Path, hashes: FileHashes) -> str:
        """Puts a file into the object store, unless it is there.

        Args:
            target: its path as a target.
            path: the file.
            hashes: what `FileHashes.of` says of it.

        Returns:
            Its key.
        """
        files = self.publisher.files
        key = target_key(target, hashes.sha256)
        files.store.ensure_bucket(files.bucket)
        if files.store.find_same(files.bucket, key, path) is None:
            files.store.put_file(files.bucket, key, path)
        self._targets[target] = TargetFile(hashes.size_bytes, {"sha256": hashes.sha256}, target)
        return key

    def add_bytes(self, target: str, content: bytes) -> str:
        """Puts a small file into the object store; returns its path as a target."""
        files = self.publisher.files
        described = TargetFile.from_data(target, content, ["sha256"])
        files.store.ensure_bucket(files.bucket)
        files.store.put_bytes(files.bucket, target_key(target, described.hashes["sha256"]), content)
        self._targets[target] = described
        return target

    def publish(self) -> None:
        """Makes all of them visible at once; of no effect if they are.

        Raises:
            ConfigurationError: a key is missing, or the store has what the keys have not signed.
            StorageError: the store does not answer.
        """
        self.publisher.publish(self._changes, [application_role(self.application)])

    def _changes(self, current: Repository | None) -> Changes | None:
        known = current.applications.get(application_role(self.application)) if current else None
        named = known.signed.targets if known else {}
        if all(named.get(path) == target for path, target in self._targets.items()):
            return None
        return Changes(add={self.application: self._targets})
