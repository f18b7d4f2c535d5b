# pyright: reportPrivateImportUsage=false
"""A fleet's TUF repository in a folder, made with `tuf.api` alone: it shares no code with what is tested."""

import hashlib
import io
import json
import tarfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from securesystemslib.signer import CryptoSigner
from tuf.api.metadata import (
    DelegatedRole,
    Delegations,
    Metadata,
    MetaFile,
    Root,
    Snapshot,
    TargetFile,
    Targets,
    Timestamp,
)
from tuf.api.serialization.json import JSONSerializer

APPLICATION = "courier"
ROLE = f"application-{APPLICATION}"
SERIALIZER = JSONSerializer(compact=True)


def bundle(files: Mapping[str, str | bytes], mode: int = 0o755) -> bytes:
    """A .tar.gz with files."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as container:
        for name, content in files.items():
            content = content.encode() if isinstance(content, str) else content
            info = tarfile.TarInfo(name)
            info.size, info.mode = len(content), mode
            container.addfile(info, io.BytesIO(content))
    return packed.getvalue()


@dataclass
class TufRepository:
    """A repository with one application; `folder` has `metadata/` and `targets/`."""

    folder: Path
    lifetime: timedelta = timedelta(days=1)
    versions: dict[str, int] = field(default_factory=dict)
    deployments: int = 0
    """How many were added; each has a larger number than the one before."""

    attested: Mapping[str, Any] | None = None
    """What roots say of attestations from the next one on; absent: nothing."""

    def __post_init__(self) -> None:
        self.signers = {
            role: CryptoSigner.generate_ed25519() for role in ("root", "targets", "snapshot", "timestamp", ROLE)
        }
        self.targets: dict[str, TargetFile] = {}
        self.new_root()
        self.publish()

    @property
    def first_root(self) -> bytes:
        """The root metadata that robots are enrolled with."""
        return (self.folder / "metadata" / "1.root.json").read_bytes()

    def new_root(self) -> None:
        """Publishes a root: the first, or the next version."""
        root = Root(version=self._next("root"), expires=self.expiry(), consistent_snapshot=True)
        for role in ("root", "targets", "snapshot", "timestamp"):
            root.add_key(self.signers[role].public_key, role)
        if self.attested is not None:
            root.unrecognized_fields["robomaker-attested"] = self.attested
        self._write(root, "root", f"{root.version}.root.json")

    def add(self, path: str, content: bytes) -> str:
        """Adds a target; it counts once it is published."""
        self.targets[path] = TargetFile.from_data(path, content, ["sha256"])
        folder, _, name = path.rpartition("/")
        file = self.folder / "targets" / folder / f"{hashlib.sha256(content).hexdigest()}.{name}"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
        return path

    def add_deployment(
        self,
        job: str,
        packed: bytes,
        *,
        version: str = "1",
        condition: bytes | None = None,
        launch: Mapping[str, Any] | None = None,
        **changes: Any,
    ) -> str:
        """Adds a bundle and its deployment document; returns the path of the document. Publishes."""
        sha256 = hashlib.sha256(packed).hexdigest()
        path = self.add(f"applications/{APPLICATION}/bundles/{sha256}.tar.gz", packed)
        self.deployments += 1
        document = {
            "format": 1,
            "number": self.deployments,
            "job": f"arn:aws:robomaker:us-west-2:123456789012:deployment-job/{job}",
            "fleet": "arn:aws:robomaker:us-west-2:123456789012:deployment-fleet/yard/1",
            "application": APPLICATION,
            "version": version,
            "bundles": {"X86_64": path, "ARM64": path, "ARMHF": path},
            "condition": None,
            "launch": {"packageName": "courier", "launchFile": "drive", **(launch or {})},
            "attestations": [],
            "tags": {},
            **changes,
        }
        if condition is not None:
            name = hashlib.sha256(condition).hexdigest()
            document["condition"] = self.add(f"applications/{APPLICATION}/conditions/{name}", condition)
        target = self.add(f"applications/{APPLICATION}/deployments/{job}.json", json.dumps(document).encode())
        self.publish()
        return target

    def publish(self) -> None:
        """Signs everything anew, timestamp last."""
        delegated = Targets(version=self._next(ROLE), expires=self.expiry(), targets=dict(self.targets))
        delegated_bytes = self._write(delegated, ROLE, f"{delegated.version}.{ROLE}.json")
        key = self.signers[ROLE].public_key
        role = DelegatedRole(ROLE, [key.keyid], 1, True, paths=[f"applications/{APPLICATION}/*/*"])
        targets = Targets(
            version=self._next("targets"),
            expires=self.expiry(),
            delegations=Delegations({key.keyid: key}, {ROLE: role}),
        )
        targets_bytes = self._write(targets, "targets", f"{targets.version}.targets.json")
        snapshot = Snapshot(
            version=self._next("snapshot"),
            expires=self.expiry(),
            meta={
                "targets.json": MetaFile.from_data(targets.version, targets_bytes, ["sha256"]),
                f"{ROLE}.json": MetaFile.from_data(delegated.version, delegated_bytes, ["sha256"]),
            },
        )
        snapshot_bytes = self._write(snapshot, "snapshot", f"{snapshot.version}.snapshot.json")
        timestamp = Timestamp(
            version=self._next("timestamp"),
            expires=self.expiry(),
            snapshot_meta=MetaFile.from_data(snapshot.version, snapshot_bytes, ["sha256"]),
        )
        self._write(timestamp, "timestamp", "timestamp.json")

    def expiry(self) -> datetime:
        """When what is signed now expires."""
        return (datetime.now(UTC) + self.lifetime).replace(microsecond=0)

    def _next(self, role: str) -> int:
        self.versions[role] = self.versions.get(role, 0) + 1
        return self.versions[role]

    def _write(self, signed: Any, role: str, name: str) -> bytes:
        metadata = Metadata(signed)
        metadata.sign(self.signers[role], append=True)
        content = metadata.to_bytes(SERIALIZER)
        path = self.folder / "metadata" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        return content
