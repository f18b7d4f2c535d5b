# pyright: reportPrivateImportUsage=false
"""How the repository stands: each role's version, whose keys sign for it, and when what it signed expires."""

from datetime import datetime
from typing import NamedTuple

from tuf.api.metadata import Root

from ...service.service import Service
from .metadata import Repository
from .publishing import delegated_roles, publisher_of
from .roles import ONLINE_ROLES, lifetime_of
from .roots import Attested

_WARN_SHARE = 2  # the service signs again long before: half of what it waits for is left only if it could not


class RoleStanding(NamedTuple):
    """How one role stands."""

    role: str
    version: int
    expires: datetime
    keyids: list[str]
    threshold: int
    warning: str
    """Advice on renewing the role, in words; empty: it needs none."""


def standing_of(service: Service) -> list[RoleStanding]:
    """How each role of a service's repository stands; nothing where there are no keys.

    Raises:
        ConfigurationError: the store has what the keys have not signed.
        StorageError: the object store does not answer.
    """
    publisher = publisher_of(service)
    if publisher.machine.root() is None:
        return []
    repository = publisher.read(publisher.root(), None)
    return [] if repository is None else standings(repository, service.clock())


def attested_of(service: Service) -> Attested:
    """Reads the attestation rules of the newest root; empty where there are no keys.

    Raises:
        ConfigurationError: the object store has another repository's root.
        StorageError: the object store does not answer.
    """
    publisher = publisher_of(service)
    return Attested() if publisher.machine.root() is None else Attested.of(publisher.root().signed)


def standings(repository: Repository, now: datetime) -> list[RoleStanding]:
    """How each role stands.

    Args:
        repository: all of it.
        now: the time.
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
    """Advises how to renew a role that expires soon; empty: it needs no renewal.

    Args:
        role: the role.
        expires: when what it signed last expires.
        now: the time.
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
