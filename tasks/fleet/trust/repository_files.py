# pyright: reportPrivateImportUsage=false
"""Files of the TUF repository in the object store: verified like a client would, each version written once.

Nothing that the store returns is trusted: everything must be signed by the keys of a root that leads back to one that
this machine knows. Expired metadata may be read here, since it is about to be signed again.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NoReturn

from tuf.api.exceptions import RepositoryError
from tuf.api.metadata import Metadata, MetaFile, Root, Snapshot, Targets, Timestamp
from tuf.api.serialization import DeserializationError

from ....schemas.wire.errors import (
    BucketNotFoundError,
    ConfigurationError,
    ObjectExistsError,
    ObjectNotFoundError,
)
from ...storage.object_store import ObjectStore
from .metadata import Content, Repository, to_metadata
from .roles import FOLDER, NEWEST_TIMESTAMP_KEY, TIMESTAMPS, metadata_key, timestamp_key


@dataclass(frozen=True)
class RepositoryFiles:
    """Files of the signed update repository (TUF metadata) in the object store."""

    store: ObjectStore
    bucket: str

    def newest_timestamp(self) -> tuple[int, bytes] | None:
        """Returns number and content of the newest TUF timestamp; `None` if nothing has been published.

        Raises:
            StorageError: The store does not answer.
        """
        try:
            numbers = [_number(info.key) for info in self.store.list(self.bucket, TIMESTAMPS)]
        except BucketNotFoundError:
            return None
        if not numbers:
            return None
        return max(numbers), self.store.get_bytes(self.bucket, timestamp_key(max(numbers)))

    def metadata(self, role: str, version: int) -> bytes:
        """Reads a version of a TUF role's metadata, as it is stored.

        Raises:
            ObjectNotFoundError: The object store has no such version.
        """
        return self.store.get_bytes(self.bucket, metadata_key(role, version))

    def newer_roots(self, known: Metadata[Root]) -> list[bytes]:
        """Reads the TUF roots that follow a known one, each verified with the root before it.

        Raises:
            ConfigurationError: A root is not signed by the keys of the root before it.
        """
        found: list[bytes] = []
        newest = known
        while True:
            version = newest.signed.version + 1
            try:
                content = self.metadata("root", version)
            except (ObjectNotFoundError, BucketNotFoundError):
                return found
            try:
                following = to_metadata(content, Root)
                newest.signed.verify_delegate("root", following.signed_bytes, following.signatures)
                following.signed.verify_delegate("root", following.signed_bytes, following.signatures)
                if following.signed.version != version:
                    raise DeserializationError(f"its version is {following.signed.version}")
            except (RepositoryError, DeserializationError) as error:
                _refuse(metadata_key("root", version), error)
            found.append(content)
            newest = following

    def read(self, root: Metadata[Root], number: int, newest: bytes, applications: Iterable[str]) -> Repository:
        """Reads the update repository's metadata, and verifies all signatures; expiry is not checked.

        Args:
            root: The root.
            number: Number of the newest timestamp.
            newest: The newest timestamp.
            applications: Delegated roles that are read as well, if they are there.

        Raises:
            ConfigurationError: A signature is missing or wrong.
            ObjectNotFoundError: A metadata file was deleted.
        """
        key = timestamp_key(number)
        timestamp = _verified(newest, Timestamp, key, root, "timestamp", number)
        described = timestamp.signed.snapshot_meta
        snapshot = self._described("snapshot", described, Snapshot, root)
        targets = self._described("targets", snapshot.signed.meta["targets.json"], Targets, root)
        known = {
            role: self._described(role, snapshot.signed.meta[f"{role}.json"], Targets, targets)
            for role in applications
            if f"{role}.json" in snapshot.signed.meta
        }
        return Repository(root, timestamp, snapshot, targets, known)

    def write(self, role: str, version: int, content: bytes) -> bool:
        """Stores a version of a TUF role's metadata; returns false if that version exists with another content."""
        return self._create(metadata_key(role, version), content)

    def commit(self, number: int, timestamp: bytes) -> bool:
        """Makes the stored metadata visible by writing the timestamp; returns false if another publisher was first.

        Afterwards it updates the unnumbered copy of the timestamp, for clients that read plain files.
        """
        if not self._create(timestamp_key(number), timestamp):
            return False
        self.copy_timestamp()
        return True

    def copy_timestamp(self) -> None:
        """Updates the unnumbered copy of the timestamp in the object store, for clients that read plain files.

        It does nothing if the copy is the newest one already, or there is no timestamp.
        """
        copied = 0
        while (newest := self.newest_timestamp()) is not None and newest[0] != copied:
            copied, content = newest
            try:
                if self.store.get_bytes(self.bucket, NEWEST_TIMESTAMP_KEY) == content:
                    return
            except ObjectNotFoundError:
                pass
            self.store.put_bytes(self.bucket, NEWEST_TIMESTAMP_KEY, content)

    def _described(
        self, role: str, meta: MetaFile, kind: type[Content], above: Metadata[Root] | Metadata[Targets]
    ) -> Metadata[Content]:
        key = metadata_key(role, meta.version)
        content = self.metadata(role, meta.version)
        try:
            meta.verify_length_and_hashes(content)
        except RepositoryError as error:
            _refuse(key, error)
        return _verified(content, kind, key, above, role, meta.version)

    def _create(self, key: str, content: bytes) -> bool:
        try:
            self.store.put_bytes(self.bucket, key, content, create_only=True)
        except ObjectExistsError:
            # After a broken connection it can be what this very call has written.
            return self.store.get_bytes(self.bucket, key) == content
        return True


def _verified(
    content: bytes,
    kind: type[Content],
    key: str,
    above: Metadata[Root] | Metadata[Targets],
    role: str,
    version: int,
) -> Metadata[Content]:
    try:
        metadata = to_metadata(content, kind)
        above.signed.verify_delegate(role, metadata.signed_bytes, metadata.signatures)
        if metadata.signed.version != version:
            raise DeserializationError(f"its version is {metadata.signed.version}")
    except (RepositoryError, DeserializationError, ValueError) as error:
        _refuse(key, error)
    return metadata


def _refuse(key: str, error: Exception) -> NoReturn:
    raise ConfigurationError(
        f"{key} of the object store is not what this machine's keys have signed ({type(error).__name__}: {error}); "
        f"somebody changed {FOLDER}, or robots/trust of the data home is that of another repository"
    ) from error


def _number(key: str) -> int:
    name = key.removeprefix(TIMESTAMPS).removesuffix(".json")
    return int(name) if name.isascii() and name.isdigit() else 0
