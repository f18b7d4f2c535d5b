# pyright: reportPrivateImportUsage=false
"""Publishes TUF metadata: new files are written beside the current ones, and become visible by one write.

```
   target files ─> N.application-….json ─> N.targets.json ─> N.snapshot.json ─> timestamps/N.json ─> timestamp.json
                   └──────── a number that exists is passed over ────────┘      └ the one write      └ a copy
```

A publisher that dies before the one write leaves files that nothing names. Of two that publish at once, one makes the
write, and the other begins again from the first one's result.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime

from securesystemslib.signer import Key, Signer
from tuf.api.metadata import Metadata, Root

from ....schemas.wire.errors import ConfigurationError, StorageError
from ...service.service import Service
from ..attestations.envelopes import attestation_key
from .keys import Machine, RandomBytes, new_key
from .metadata import Attested, Changes, Next, Repository, first_root, next_repository, to_bytes, to_metadata
from .repository_files import RepositoryFiles
from .roles import APPLICATIONS, KEY_ROLES, ONLINE_ROLES, lifetime_of

_TRIES = 200  # a publisher that is always too late is told so in the end

Decide = Callable[[Repository | None], Changes | None]
"""Function that chooses changes to the repository; `None`: no changes.

It is called again when another publisher was quicker.
"""


@dataclass(frozen=True)
class Coming:
    """Keys that will be valid once the next TUF root is published."""

    root: Metadata[Root] | None = None
    """Next TUF root; its keys sign as well, so that robots that have it already accept the files, too."""

    applications: Signer | None = None
    """New key that signs for all applications; it needs no new root, since the role `targets` names it."""


@dataclass(frozen=True)
class Publisher:
    """Publishes signed updates for robots from one machine; several may do so concurrently."""

    files: RepositoryFiles
    """Storage of the TUF repository's files."""

    machine: Machine
    """Keys, and the last repository state that this machine has seen."""

    clock: Callable[[], datetime]
    """Function that returns the time, with its zone."""

    random_bytes: RandomBytes
    """Source of random bytes for new signing keys."""

    attestation_key: Callable[[], Key] | None = None
    """Function that returns this machine's public attestation key; `None`: roots made here name no such key."""

    def attested(self) -> Attested:
        """Returns the attestation rules for a first TUF root."""
        return Attested().changed([self.attestation_key()] if self.attestation_key else [], (), ())

    def root(self) -> Metadata[Root]:
        """Returns the newest TUF root; the first time, keys and a root are created.

        Raises:
            ConfigurationError: The object store has another repository's root.
            StorageError: The object store does not answer.
        """
        known = self.machine.root() or self._first_root()
        roots = self.files.newer_roots(known)
        if roots:
            with self.machine.keys.held():
                self.machine.note_root(roots[-1])
        return to_metadata(roots[-1], Root) if roots else known

    def begin(self, root: Metadata[Root]) -> None:
        """Stores the first TUF root in the object store.

        Raises:
            ConfigurationError: The object store has another first root.
        """
        self.files.store.ensure_bucket(self.files.bucket)
        if not self.files.write("root", root.signed.version, to_bytes(root)):
            raise ConfigurationError(
                f"the object store has the repository of other keys already; copy {self.machine.folder} from the "
                "machine that made it (docs/fleet/fleet-trust.md)"
            )

    def read(self, root: Metadata[Root], applications: Sequence[str] | None = ()) -> Repository | None:
        """Reads and verifies the update repository's metadata.

        Args:
            root: The newest root.
            applications: Delegated roles that are read as well; `None`: all of them.

        Returns:
            `None`: nothing has been published.

        Raises:
            ConfigurationError: A signature is missing or wrong, or the repository was reset to an earlier state.
        """
        seen = self.machine.seen()
        newest = self.files.newest_timestamp()
        number, content = newest or (0, b"")
        self.machine.check_seen(number, seen)
        if newest is None:
            return None
        repository = self.files.read(root, number, content, applications or ())
        self.machine.note_seen(number)
        if applications is None:
            return self.files.read(root, number, content, delegated_roles(repository))
        return repository

    def publish(
        self, decide: Decide, applications: Sequence[str] | None = (), coming: Coming | None = None
    ) -> Repository | None:
        """Publishes changes to the update repository, with all signatures in order.

        Args:
            decide: Chooses the changes.
            applications: Delegated roles that it is to see; `None`: all of them.
            coming: Keys that are about to count.

        Returns:
            Metadata of the repository after the changes.

        Raises:
            ConfigurationError: A key is missing, or the store has what they have not signed.
            StorageError: The object store does not answer, or other publishers changed the repository at each attempt.
        """
        taken: dict[str, int] = {}
        for _ in range(_TRIES):
            root = self.root()
            current = self.read(root, applications)
            if current is None and root.signed.version == 1:
                self.begin(root)
            changes = decide(current)
            if changes is None:
                return current
            if current is not None and _is_due("targets", current.targets.signed.expires, self.clock()):
                changes = replace(changes, resign=changes.resign | {"targets"})
            signers = self._signers(current, root, coming or Coming())
            after = next_repository(root, current, changes, signers, self.clock(), taken)
            if self._write(after, taken) and self.files.commit(number := _number(after), after.timestamp):
                self.machine.note_seen(number)
                return after.repository
        raise StorageError(f"others kept publishing to the robots' repository; {_TRIES} tries were too late")

    def keep_up(self) -> Repository | None:
        """Renews signatures that would expire: the timestamp every six hours, others long before their time.

        Returns:
            Metadata of the repository after renewal; `None`: there is none, or this machine has no keys.

        Raises:
            ConfigurationError: A key is missing, or the store has what they have not signed.
            StorageError: The object store does not answer.
        """
        known = self.machine.root()
        if known is None:
            return None
        current = self.read(self.root())
        if current is None or not _is_due("timestamp", current.timestamp.signed.expires, self.clock()):
            with suppress(StorageError):
                self.files.copy_timestamp()
            return current
        return self.publish(lambda now: None if now is None else self._due(now), None)

    def _due(self, repository: Repository) -> Changes | None:
        now = self.clock()
        if not _is_due("timestamp", repository.timestamp.signed.expires, now):
            return None  # another machine has just done it
        signed = {"targets": repository.targets, **repository.applications}
        due = {role for role, each in signed.items() if _is_due(role, each.signed.expires, now)}
        if _is_due("snapshot", repository.snapshot.signed.expires, now):
            due.add("snapshot")
        return Changes(resign=frozenset(due))

    def _first_root(self) -> Metadata[Root]:
        with self.machine.keys.held():
            if (known := self.machine.root()) is not None:
                return known
            keys = {role: self._key(role) for role in KEY_ROLES}
            online = {role: keys[role].public_key for role in ONLINE_ROLES}
            root = first_root([keys["root"]], 1, online, self.clock(), self.attested())
            self.machine.note_root(to_bytes(root))  # before the store has it: nothing else can make this one again
            return root

    def _key(self, role: str) -> Signer:
        found = self.machine.keys.of_role(role)
        return found[0] if found else new_key(role, self.machine.folder, self.random_bytes)

    def _signers(
        self, current: Repository | None, root: Metadata[Root], coming: Coming
    ) -> Callable[[str], Sequence[Signer]]:
        keys, following = self.machine.keys, coming.root
        delegations = current.targets.signed.delegations if current else None

        def signers(role: str) -> Sequence[Signer]:
            if role != APPLICATIONS:
                keyids = {*root.signed.roles[role].keyids, *(following.signed.roles[role].keyids if following else ())}
                return keys.among(role, keyids)
            if coming.applications is not None:
                return [coming.applications]
            if delegations is None or not delegations.keys:
                return keys.of_role(APPLICATIONS)[:1]
            return keys.among(APPLICATIONS, delegations.keys)

        return signers

    def _write(self, after: Next, taken: dict[str, int]) -> bool:
        for role, version, content in after.files:
            if not self.files.write(role, version, content):
                taken[role] = version
                return False
        return True


def publisher_of(service: Service) -> Publisher:
    """Returns the update publisher of a service on this machine."""
    files = RepositoryFiles(service.store, service.settings.bucket)
    machine = Machine(service.settings.home / "robots" / "trust")
    return Publisher(
        files, machine, service.clock, service.chance.randbytes, lambda: attestation_key(service).public_key
    )


def delegated_roles(repository: Repository) -> list[str]:
    """Returns the names of the TUF roles delegated to single applications."""
    delegations = repository.targets.signed.delegations
    return sorted((delegations.roles if delegations else None) or {})


def roles_signed(repository: Repository | None) -> list[str]:
    """Returns all TUF roles that this machine may re-sign, without the timestamp, which always is."""
    return [] if repository is None else ["targets", "snapshot", *delegated_roles(repository)]


def _is_due(role: str, expires: datetime, now: datetime) -> bool:
    return lifetime_of(role).is_due(expires, now)


def _number(after: Next) -> int:
    return after.repository.timestamp.signed.version
