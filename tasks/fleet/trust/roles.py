"""The roles of the repository: their names, how long what they sign is valid, and where it lies."""

from dataclasses import dataclass
from datetime import datetime, timedelta

ONLINE_ROLES = ("targets", "snapshot", "timestamp")
"""Roles that the root names besides itself; the service has their keys."""

APPLICATIONS = "applications"
"""The key of all delegated roles, of which there is one for each application."""

KEY_ROLES = ("root", *ONLINE_ROLES, APPLICATIONS)
"""Roles, and groups of roles, that have keys of their own."""

FOLDER = "robots/repository"
"""Prefix of the repository's keys in the service's bucket."""

_APPLICATION_ROLE = "application-"


@dataclass(frozen=True)
class Lifetime:
    """How long what a role signs is valid."""

    valid: timedelta
    """From its signature on."""

    renew_before: timedelta
    """It is signed again once less than that is left; for the root, people are warned."""

    def is_due(self, expires: datetime, now: datetime) -> bool:
        """Whether it is to be signed again."""
        return expires - now < self.renew_before


LIFETIMES = {
    # The lifetime of the timestamp is for how long an attacker can keep news from a robot without its noticing.
    "timestamp": Lifetime(timedelta(days=1), timedelta(hours=18)),
    "snapshot": Lifetime(timedelta(days=7), timedelta(days=5)),
    "targets": Lifetime(timedelta(days=90), timedelta(days=45)),
    "root": Lifetime(timedelta(days=365), timedelta(days=60)),
}
"""Lifetimes of signatures by role; delegated roles have that of `targets`."""


def lifetime_of(role: str) -> Lifetime:
    """How long what a role signs is valid; `role` may be a delegated one."""
    return LIFETIMES.get(role) or LIFETIMES["targets"]


def application_role(application: str) -> str:
    """The delegated role of an application."""
    return _APPLICATION_ROLE + application


def application_of(role: str) -> str | None:
    """The application of a delegated role; `None`: it is none."""
    return role.removeprefix(_APPLICATION_ROLE) if role.startswith(_APPLICATION_ROLE) else None


def target_folder(application: str) -> str:
    """Folder of an application's targets: the prefix of their paths."""
    return f"applications/{application}"


def metadata_key(role: str, version: int) -> str:
    """Key of a version of a role's metadata in the bucket; its content never changes."""
    return f"{FOLDER}/metadata/{version}.{role}.json"


NEWEST_TIMESTAMP_KEY = f"{FOLDER}/metadata/timestamp.json"
"""Copy of the newest timestamp, for those who read the repository as plain files."""

TIMESTAMPS = f"{FOLDER}/timestamps/"
"""The numbered timestamps, of which the newest decides what the repository is."""


def timestamp_key(version: int) -> str:
    """Key of a numbered timestamp in the bucket."""
    return f"{TIMESTAMPS}{version}.json"


def target_key(path: str, sha256: str) -> str:
    """Key of a target's content in the bucket: TUF puts the hash before the name.

    Args:
        path: of the target.
        sha256: of its content, in hexadecimal digits.
    """
    folder, _, name = path.rpartition("/")
    return f"{FOLDER}/targets/{folder}/{sha256}.{name}"
