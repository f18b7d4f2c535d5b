"""Computes the next TUF metadata as a pure function of the current metadata, the changes, the keys and the time.

A version number that another publisher has used already, and may have died over, is skipped: `taken`.
"""

# pyright: reportPrivateImportUsage=false

from collections.abc import Callable, Collection, Mapping, Sequence
from copy import deepcopy
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

from ....schemas.wire.errors import ConfigurationError
from .roles import APPLICATIONS, ONLINE_ROLES, application_of, application_role, lifetime_of, target_folder

SignersOf = Callable[[str], Sequence[Signer]]
"""Function that returns the keys (at least one) that sign for a role.

The roles are those of `roles.ONLINE_ROLES`, and `roles.APPLICATIONS`.
"""

Content = TypeVar("Content", Root, Timestamp, Snapshot, Targets)

_HASH = ["sha256"]


@dataclass(frozen=True)
class Repository:
    """Signed metadata (TUF) of the update repository for robots."""

    root: Metadata[Root]
    timestamp: Metadata[Timestamp]
    snapshot: Metadata[Snapshot]
    targets: Metadata[Targets]
    applications: Mapping[str, Metadata[Targets]] = field(default_factory=dict)
    """Metadata of delegated roles, by role; only of roles that were read."""


@dataclass(frozen=True)
class Changes:
    """Changes to make to the update repository: files to add and remove, roles to sign again."""

    add: Mapping[str, Mapping[str, TargetFile]] = field(default_factory=dict)
    """New target files of the TUF repository, by application and path."""

    remove: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Paths of target files to remove from the TUF repository, by application."""

    resign: frozenset[str] = frozenset()
    """Roles that are signed again without changes; their metadata must have been read."""


@dataclass(frozen=True)
class Next:
    """New metadata files of the update repository to write: `files` in this order, then the timestamp."""

    repository: Repository
    files: tuple[tuple[str, int, bytes], ...]
    """TUF role, version and content of each metadata file to write."""

    timestamp: bytes


Taken = Mapping[str, int]
"""Highest version of each role that is used already, although the repository does not name it."""


def to_bytes(metadata: Metadata) -> bytes:
    """Serialises TUF metadata to the bytes that are stored."""
    return metadata.to_bytes(JSONSerializer(compact=True))


def to_metadata(content: bytes, kind: type[Content]) -> Metadata[Content]:
    """Parses TUF metadata; signatures are not checked.

    Raises:
        DeserializationError: The content is not TUF metadata, or is that of another role.
    """
    metadata = Metadata.from_bytes(content)
    if not isinstance(metadata.signed, kind):
        raise DeserializationError(f"it is metadata of {metadata.signed.type}")
    return cast("Metadata[Content]", metadata)


def signed(content: Content, signers: Sequence[Signer]) -> Metadata[Content]:
    """Makes TUF metadata of a role's content, signed with the given keys."""
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
    """Makes the update repository's new metadata with some changes.

    Args:
        root: The root that robots have, or are about to get.
        current: The repository now; `None`: it is empty.
        changes: Changes to make.
        signers_of: The keys.
        now: The time.
        taken: Versions that are used already.
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
    """Builds the TUF metadata of one publishing step, and collects the files to write."""

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


MOST_ROOT_KEYS = 16
"""Limit of the number of root keys: people do not keep more."""

EVERY_APPLICATION = "*"
"""Name that stands for all applications in the list of those that need an attestation."""

_ATTESTED = "robomaker-attested"


@dataclass(frozen=True)
class Attested:
    """Rules in a TUF root: which applications need attestations, and by which keys."""

    keys: Mapping[str, Key] = field(default_factory=dict[str, Key])
    """Public keys whose attestations agents accept, by id; empty: agents do not check attestations."""

    applications: frozenset[str] = frozenset()
    """Applications of which agents install no version without an attestation."""

    @classmethod
    def of(cls, root: Root) -> "Attested":
        """Reads the attestation rules from a TUF root."""
        content = root.unrecognized_fields.get(_ATTESTED) or {"keys": {}, "applications": []}
        keys = {keyid: Key.from_dict(keyid, dict(key)) for keyid, key in content["keys"].items()}
        return cls(keys, frozenset(content["applications"]))

    def changed(self, keys: Collection[Key], add: Collection[str], remove: Collection[str]) -> "Attested":
        """Returns attestation rules with other keys (if given), and with applications added or removed."""
        named = {key.keyid: key for key in keys} or self.keys
        return Attested(named, (self.applications | frozenset(add)) - frozenset(remove))

    def demands(self, application: str) -> bool:
        """Whether each deployment of an application needs an attestation."""
        return not self.applications.isdisjoint((application, EVERY_APPLICATION))

    def write_to(self, root: Root) -> None:
        """Writes the attestation rules into a TUF root."""
        keys = {keyid: key.to_dict() for keyid, key in self.keys.items()}
        root.unrecognized_fields[_ATTESTED] = {"keys": keys, "applications": sorted(self.applications)}


def check_ceremony(root_keys: int, threshold: int) -> None:
    """Raises an error for senseless numbers of root keys and required signatures.

    Raises:
        ConfigurationError: Names the number and what would be right.
    """
    if not 1 <= root_keys <= MOST_ROOT_KEYS:
        raise ConfigurationError(f"root keys: {root_keys} is not right; 1 to {MOST_ROOT_KEYS} are")
    if not 1 <= threshold <= root_keys:
        raise ConfigurationError(f"threshold: {threshold} is not right; 1 to {root_keys}, the number of keys, are")


def first_root(
    root_keys: Sequence[Signer], threshold: int, online: Mapping[str, Key], now: datetime, attested: Attested
) -> Metadata[Root]:
    """Makes the first TUF root, signed by all root keys.

    Args:
        root_keys: Keys whose signatures are needed for the next root.
        threshold: Number of root keys that must sign the next root.
        online: The key of each of `ONLINE_ROLES`.
        now: The time.
        attested: Attestation rules of the root.
    """
    root = Root(version=1, expires=_expires(now), consistent_snapshot=True)
    for signer in root_keys:
        root.add_key(signer.public_key, Root.type)
    root.roles[Root.type].threshold = threshold
    for role in ONLINE_ROLES:
        root.add_key(online[role], role)
    attested.write_to(root)
    return signed(root, root_keys)


def following_root(
    known: Metadata[Root], now: datetime, replaced: Mapping[str, Sequence[Key]], attested: Attested | None = None
) -> Metadata[Root]:
    """Makes the TUF root that follows the newest one, still without signatures.

    Args:
        known: The newest root.
        now: The time.
        replaced: New keys of the roles whose keys are replaced.
        attested: Attestation rules of the root; absent: the same as before.
    """
    root = deepcopy(known.signed)
    root.version += 1
    root.expires = _expires(now)
    for role, keys in replaced.items():
        for keyid in list(root.roles[role].keyids):
            root.revoke_key(keyid, role)
        for key in keys:
            root.add_key(key, role)
    if attested is not None:
        attested.write_to(root)
    return Metadata(root)


def sign_root(draft: Metadata[Root], known: Metadata[Root], signers: Sequence[Signer]) -> None:
    """Adds signatures to the draft of a TUF root.

    Args:
        draft: The root; signatures of others stay.
        known: The one before it.
        signers: The keys.

    Raises:
        ConfigurationError: A key is none of either root.
    """
    counting = {*draft.signed.roles[Root.type].keyids, *known.signed.roles[Root.type].keyids}
    for signer in signers:
        if signer.public_key.keyid not in counting:
            raise ConfigurationError(
                f"the key {signer.public_key.keyid[:16]}… is no root key, neither before nor after; "
                f"root keys are {', '.join(sorted(keyid[:16] for keyid in counting))}"
            )
        draft.sign(signer, append=True)


def missing_signatures(draft: Metadata[Root], known: Metadata[Root]) -> int:
    """Returns how many signatures a TUF root still needs, by its own rules and those of the root before it."""
    return max(_missing(above, draft) for above in (known.signed, draft.signed))


def _missing(above: Root, draft: Metadata[Root]) -> int:
    result = above.get_verification_result(Root.type, draft.signed_bytes, draft.signatures)
    return max(0, result.threshold - len(result.signed))


def _expires(now: datetime) -> datetime:
    return now.replace(microsecond=0) + lifetime_of(Root.type).valid
