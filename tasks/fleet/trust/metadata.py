# pyright: reportPrivateImportUsage=false
"""Next metadata of the repository, as a pure function of the current metadata, the changes, the keys and the time.

A version number that another publisher has used already, and may have died over, is passed over: `taken`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import TypeVar, cast

from securesystemslib.signer import Signer
from tuf.api.metadata import (
    DelegatedRole,
    Delegations,
    Key,
    Metadata,
    MetaFile,
    Root,
    Snapshot,
    TargetFile,
    Targets,
    Timestamp,
)
from tuf.api.serialization import DeserializationError
from tuf.api.serialization.json import JSONSerializer

from .roles import APPLICATIONS, application_of, application_role, lifetime_of, target_folder

SignersOf = Callable[[str], Sequence[Signer]]
"""The keys that sign for a role, of `roles.ONLINE_ROLES` or `roles.APPLICATIONS`; one at least."""

Content = TypeVar("Content", Root, Timestamp, Snapshot, Targets)

_HASH = ["sha256"]


@dataclass(frozen=True)
class Repository:
    """Signed metadata of the repository."""

    root: Metadata[Root]
    timestamp: Metadata[Timestamp]
    snapshot: Metadata[Snapshot]
    targets: Metadata[Targets]
    applications: Mapping[str, Metadata[Targets]] = field(default_factory=dict)
    """Metadata of delegated roles, by role; of those that were read."""


@dataclass(frozen=True)
class Changes:
    """Changes to the repository: targets to add and to remove, roles to sign again."""

    add: Mapping[str, Mapping[str, TargetFile]] = field(default_factory=dict)
    """Targets that come, by application and path."""

    remove: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Paths of targets that go, by application."""

    resign: frozenset[str] = frozenset()
    """Roles that are signed again though they say the same; their metadata has to have been read."""


@dataclass(frozen=True)
class Next:
    """Metadata files to write: `files` in this order, and then the timestamp."""

    repository: Repository
    files: tuple[tuple[str, int, bytes], ...]
    """Role, version and content of each."""

    timestamp: bytes


Taken = Mapping[str, int]
"""The highest version of roles that is used already, though the repository does not name it."""


def to_bytes(metadata: Metadata) -> bytes:
    """Metadata as it is written."""
    return metadata.to_bytes(JSONSerializer(compact=True))


def to_metadata(content: bytes, kind: type[Content]) -> Metadata[Content]:
    """Reads metadata; nothing of it is checked.

    Raises:
        DeserializationError: it is none, or of another kind.
    """
    metadata = Metadata.from_bytes(content)
    if not isinstance(metadata.signed, kind):
        raise DeserializationError(f"it is metadata of {metadata.signed.type}")
    return cast("Metadata[Content]", metadata)


def signed(content: Content, signers: Sequence[Signer]) -> Metadata[Content]:
    """Metadata with a content, and the signatures of some keys."""
    metadata = Metadata(content)
    for signer in signers:
        metadata.sign(signer, append=True)
    return metadata


def next_repository(
    root: Metadata[Root],
    current: Repository | None,
    changes: Changes,
    signers_of: SignersOf,
    now: datetime,
    taken: Taken,
) -> Next:
    """Makes the metadata of the repository with some changes.

    Args:
        root: the root that robots have, or are about to get.
        current: what it says; `None`: nothing yet.
        changes: what is to be different.
        signers_of: the keys.
        now: the time.
        taken: versions that are used already.
    """
    step = _Step(signers_of, now, taken)
    named = {application_role(each) for each in (*changes.add, *changes.remove)}
    touched = sorted(named | {role for role in changes.resign if application_of(role) is not None})
    known = dict(current.applications) if current else {}
    for role in touched:
        known[role] = step.application(known.get(role), changes, role)
    targets = step.targets(current and current.targets, touched, is_due="targets" in changes.resign)
    if current is None or step.files or "snapshot" in changes.resign:
        snapshot = step.snapshot(current and current.snapshot, targets, {role: known[role] for role in touched})
    else:
        snapshot = current.snapshot
    timestamp = step.timestamp(current and current.timestamp, snapshot)
    after = Repository(root, timestamp, snapshot, targets, known)
    return Next(after, tuple(step.files), to_bytes(timestamp))


class _Step:
    """Makes the metadata of one step, and notes which files are to be written."""

    def __init__(self, signers_of: SignersOf, now: datetime, taken: Taken) -> None:
        self._signers_of = signers_of
        self._now = now.replace(microsecond=0)
        self._taken = taken
        self.files: list[tuple[str, int, bytes]] = []

    def application(self, before: Metadata[Targets] | None, changes: Changes, role: str) -> Metadata[Targets]:
        application = application_of(role) or ""
        gone = changes.remove.get(application, frozenset())
        kept = {path: each for path, each in (before.signed.targets if before else {}).items() if path not in gone}
        kept |= changes.add.get(application, {})
        version = self._version(role, before.signed.version if before else 0)
        return self._signed(role, Targets(version, expires=self._expires(role), targets=dict(sorted(kept.items()))))

    def targets(self, before: Metadata[Targets] | None, roles: Sequence[str], *, is_due: bool) -> Metadata[Targets]:
        known = before.signed.delegations if before else None
        delegated = dict((known.roles if known else None) or {})
        keys = [signer.public_key for signer in self._signers_of(APPLICATIONS)]
        wanted = {role: _delegated(role, keys) for role in sorted({*delegated, *roles})}
        if before is not None and wanted == delegated and not is_due:
            return before
        version = self._version("targets", before.signed.version if before else 0)
        delegations = Delegations({key.keyid: key for key in keys} if wanted else {}, wanted)
        content = Targets(version, expires=self._expires("targets"), targets={}, delegations=delegations)
        return self._signed("targets", content)

    def snapshot(
        self,
        before: Metadata[Snapshot] | None,
        targets: Metadata[Targets],
        applications: Mapping[str, Metadata[Targets]],
    ) -> Metadata[Snapshot]:
        listed = dict(before.signed.meta) if before else {}
        listed["targets.json"] = _described(targets)
        listed |= {f"{role}.json": _described(each) for role, each in applications.items()}
        version = self._version("snapshot", before.signed.version if before else 0)
        return self._signed("snapshot", Snapshot(version, expires=self._expires("snapshot"), meta=listed))

    def timestamp(self, before: Metadata[Timestamp] | None, snapshot: Metadata[Snapshot]) -> Metadata[Timestamp]:
        version = self._version("timestamp", before.signed.version if before else 0)
        content = Timestamp(version, expires=self._expires("timestamp"), snapshot_meta=_described(snapshot))
        return signed(content, self._signers_of("timestamp"))

    def _signed(self, role: str, content: Content) -> Metadata[Content]:
        metadata = signed(content, self._signers_of(APPLICATIONS if application_of(role) else role))
        self.files.append((role, content.version, to_bytes(metadata)))
        return metadata

    def _version(self, role: str, before: int) -> int:
        return max(before, self._taken.get(role, 0)) + 1

    def _expires(self, role: str) -> datetime:
        return self._now + lifetime_of(role).valid


def _delegated(role: str, keys: Sequence[Key]) -> DelegatedRole:
    application = application_of(role) or ""
    paths = [f"{target_folder(application)}/*/*"]
    return DelegatedRole(role, [key.keyid for key in keys], 1, terminating=True, paths=paths)


def _described(metadata: Metadata) -> MetaFile:
    return MetaFile.from_data(metadata.signed.version, to_bytes(metadata), _HASH)
