"""Upkeep of the TUF repository: expiry of its metadata, and removal of unneeded files."""

# pyright: reportPrivateImportUsage=false

import json
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from tuf.api.metadata import Root, Snapshot, Targets, Timestamp
from tuf.api.serialization import DeserializationError

from ....schemas.wire.errors import BucketNotFoundError, ObjectNotFoundError
from ...service.service import Service
from ...storage.object_store import ObjectInfo
from .metadata import Attested, Changes, Repository, to_metadata
from .publishing import Publisher, delegated_roles, publisher_of
from .repository_files import RepositoryFiles
from .roles import FOLDER, ONLINE_ROLES, TIMESTAMPS, application_of, lifetime_of, target_key, timestamp_key

_WARN_SHARE = 2  # the service signs again long before: half of what it waits for is left only if it could not


class RoleStanding(NamedTuple):
    """Status of one TUF role: version, expiry, keys, and advice if it has to be renewed."""

    role: str
    version: int
    expires: datetime
    keyids: list[str]
    threshold: int
    warning: str
    """Advice on renewing a TUF role's signature, in words; empty: none is needed."""


def standing_of(service: Service) -> list[RoleStanding]:
    """Returns the status of each TUF role of a service's update repository; empty where there are no keys.

    Raises:
        ConfigurationError: The store has what the keys have not signed.
        StorageError: The object store does not answer.
    """
    publisher = publisher_of(service)
    if publisher.machine.root() is None:
        return []
    repository = publisher.read(publisher.root(), None)
    return [] if repository is None else standings(repository, service.clock())


def attested_of(service: Service) -> Attested:
    """Reads the attestation rules of the newest TUF root; empty where there are no keys.

    Raises:
        ConfigurationError: The object store has another repository's root.
        StorageError: The object store does not answer.
    """
    publisher = publisher_of(service)
    return Attested() if publisher.machine.root() is None else Attested.of(publisher.root().signed)


def standings(repository: Repository, now: datetime) -> list[RoleStanding]:
    """Returns the status of each TUF role in verified metadata.

    Args:
        repository: All of it.
        now: The time.
    """
    root = repository.root.signed
    content = {
        Root.type: root,
        "targets": repository.targets.signed,
        "snapshot": repository.snapshot.signed,
        "timestamp": repository.timestamp.signed,
        **{role: repository.applications[role].signed for role in delegated_roles(repository)},
    }
    found: list[RoleStanding] = []
    for role, each in content.items():
        above = root if role in (Root.type, *ONLINE_ROLES) else repository.targets.signed
        delegated = above.get_delegated_role(role)
        warning = warning_of(role, each.expires, now)
        found.append(RoleStanding(role, each.version, each.expires, delegated.keyids, delegated.threshold, warning))
    return found


def warning_of(role: str, expires: datetime, now: datetime) -> str:
    """Advises how to renew a TUF role's signature that expires soon; empty if no renewal is needed.

    Args:
        role: The role.
        expires: Expiry of the role's latest signature.
        now: The time.
    """
    left = expires - now
    ahead = lifetime_of(role).renew_before
    if left > (ahead if role == Root.type else ahead / _WARN_SHARE):
        return ""
    remedy = (
        "sign a new one with `robomaker robots keys renew-root`"
        if role == Root.type
        else ("let `robomaker serve` run where the keys are, or call `robomaker robots keys renew`")
    )
    told = (
        f"expired on {expires:%Y-%m-%d %H:%M} UTC, and agents install nothing"
        if left.total_seconds() <= 0
        else (f"expires on {expires:%Y-%m-%d %H:%M} UTC, and agents install nothing from then on")
    )
    return f"{role} {told}; {remedy}"


_KEPT_AFTER = timedelta(days=7)
"""Time that an expired timestamp is kept: a publisher that was stopped for so long must not reuse its number."""


@dataclass(frozen=True)
class Unneeded:
    """Files of the update repository that no deployment needs and that can be deleted."""

    targets: Mapping[str, frozenset[str]]
    """Paths of TUF target files that no deployment needs, by application."""

    objects: tuple[ObjectInfo, ...]
    """Objects to delete: contents of these targets, contents that nothing names, and old metadata."""


def find_unneeded(publisher: Publisher, documents: Set[str]) -> Unneeded:
    """Finds files of the update repository that no deployment needs.

    Args:
        publisher: Publisher on this machine; no deployment may be published meanwhile.
        documents: Paths of the documents of the deployments that are needed.

    Raises:
        ConfigurationError: The store has what the keys have not signed.
        StorageError: The object store does not answer.
    """
    if publisher.machine.root() is None:
        return Unneeded({}, ())
    repository = publisher.read(publisher.root(), None)
    if repository is None:
        return Unneeded({}, ())
    files = publisher.files
    gone: dict[str, frozenset[str]] = {}
    kept_keys: set[str] = set()
    for role, metadata in repository.applications.items():
        named = metadata.signed.targets
        needed = _needed(documents, metadata.signed, files)
        gone[application_of(role) or ""] = frozenset(named.keys() - needed)
        kept_keys |= {target_key(path, named[path].hashes["sha256"]) for path in needed}
    contents = [info for info in _list(files, f"{FOLDER}/targets/") if info.key not in kept_keys]
    old = _old_metadata(files, repository, publisher)
    return Unneeded({name: paths for name, paths in gone.items() if paths}, (*contents, *old))


def remove_unneeded(publisher: Publisher, unneeded: Unneeded) -> None:
    """Deletes the files that `find_unneeded` found.

    Raises:
        ConfigurationError: A key is missing.
        StorageError: The store does not answer.
    """
    if unneeded.targets:
        publisher.publish(lambda _: Changes(remove=unneeded.targets), None)
    for info in unneeded.objects:
        publisher.files.store.delete(info.bucket, info.key)


def _needed(documents: Set[str], application: Targets, files: RepositoryFiles) -> set[str]:
    """Returns the target paths of an application that needed documents name, and of the documents themselves."""
    found: set[str] = set()
    for path in documents & application.targets.keys():
        key = target_key(path, application.targets[path].hashes["sha256"])
        found |= {path, *_named_in(json.loads(files.store.get_bytes(files.bucket, key)))}
    return found & application.targets.keys()


def _named_in(document: Mapping[str, Any]) -> Iterable[str]:
    condition = document["condition"]
    return [*document["bundles"].values(), *document["attestations"], *([condition] if condition else [])]


def _old_metadata(files: RepositoryFiles, now: Repository, publisher: Publisher) -> list[ObjectInfo]:
    """Returns timestamps that expired long ago, and metadata that no remaining timestamp refers to; no roots."""
    before = publisher.clock() - _KEPT_AFTER
    newest = now.timestamp.signed.version
    old: list[ObjectInfo] = []
    kept: set[tuple[str, int]] = set()
    for info in _list(files, TIMESTAMPS):
        timestamp = to_metadata(files.store.get_bytes(files.bucket, info.key), Timestamp)
        if timestamp.signed.expires < before and info.key != timestamp_key(newest):
            old.append(info)
        else:
            kept |= _led_to(files, timestamp.signed.snapshot_meta.version)
    current = {name.removesuffix(".json"): meta.version for name, meta in now.snapshot.signed.meta.items()}
    current["snapshot"] = now.snapshot.signed.version
    for info in _list(files, f"{FOLDER}/metadata/"):
        version, _, name = info.key.rpartition("/")[2].removesuffix(".json").partition(".")
        # Newer ones are about to be published.
        if (
            version.isdecimal()
            and name in current
            and int(version) < current[name]
            and (name, int(version)) not in kept
        ):
            old.append(info)
    return old


def _led_to(files: RepositoryFiles, version: int) -> set[tuple[str, int]]:
    """Returns the TUF role versions that a snapshot refers to, and the snapshot itself."""
    try:
        snapshot = to_metadata(files.metadata("snapshot", version), Snapshot)
    except (ObjectNotFoundError, DeserializationError):
        return set()
    named = {(name.removesuffix(".json"), meta.version) for name, meta in snapshot.signed.meta.items()}
    return {("snapshot", version), *named}


def _list(files: RepositoryFiles, prefix: str) -> list[ObjectInfo]:
    try:
        return list(files.store.list(files.bucket, prefix))
    except BucketNotFoundError:
        return []
