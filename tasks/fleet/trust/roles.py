"""Roles of the TUF repository: names, signature lifetimes and storage keys, and reading their files for robots."""

import re
import threading
import time
from collections import OrderedDict
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from ....schemas.wire.errors import BucketNotFoundError, ObjectNotFoundError
from ...service.service import Service

ONLINE_ROLES = ("targets", "snapshot", "timestamp")
"""TUF roles besides the root whose keys the service has."""

APPLICATIONS = "applications"
"""Name of the key of all delegated roles; there is one delegated role for each application."""

KEY_ROLES = ("root", *ONLINE_ROLES, APPLICATIONS)
"""Roles, and groups of roles, that have keys of their own."""

FOLDER = "robots/repository"
"""Key prefix of the TUF repository in the service's bucket."""

_APPLICATION_ROLE = "application-"


@dataclass(frozen=True)
class Lifetime:
    """Time for which a TUF role's signatures are valid, and after which they are renewed."""

    valid: timedelta
    """Validity of a TUF role's signature, counted from the time of signing."""

    renew_before: timedelta
    """Remaining validity below which a role's metadata is signed again; for the root, people are warned."""

    def is_due(self, expires: datetime, now: datetime) -> bool:
        """Whether TUF metadata with a given expiry should be signed again now."""
        return expires - now < self.renew_before


LIFETIMES = {
    # The lifetime of the timestamp is for how long an attacker can keep news from a robot without its noticing.
    "timestamp": Lifetime(timedelta(days=1), timedelta(hours=18)),
    "snapshot": Lifetime(timedelta(days=7), timedelta(days=5)),
    "targets": Lifetime(timedelta(days=90), timedelta(days=45)),
    "root": Lifetime(timedelta(days=365), timedelta(days=60)),
}
"""Lifetimes of signatures by role; delegated roles have the lifetime of `targets`."""


def lifetime_of(role: str) -> Lifetime:
    """Returns how long signatures of a TUF role are valid; delegated roles included."""
    return LIFETIMES.get(role) or LIFETIMES["targets"]


def application_role(application: str) -> str:
    """Returns the name of the TUF role that signs an application's updates."""
    return _APPLICATION_ROLE + application


def application_of(role: str) -> str | None:
    """Returns the application whose updates a TUF role signs; `None` if it is no such role."""
    return role.removeprefix(_APPLICATION_ROLE) if role.startswith(_APPLICATION_ROLE) else None


def target_folder(application: str) -> str:
    """Returns the path prefix of an application's files in the update repository."""
    return f"applications/{application}"


def metadata_key(role: str, version: int) -> str:
    """Returns the object-store key of a version of a TUF role's metadata; its content never changes."""
    return f"{FOLDER}/metadata/{version}.{role}.json"


NEWEST_TIMESTAMP_KEY = f"{FOLDER}/metadata/timestamp.json"
"""Object-store key of the copy of the newest timestamp, for clients that read the repository as plain files."""

TIMESTAMPS = f"{FOLDER}/timestamps/"
"""Object-store prefix of the numbered timestamps; the newest one decides which metadata is current."""


def timestamp_key(version: int) -> str:
    """Returns the object-store key of a numbered TUF timestamp."""
    return f"{TIMESTAMPS}{version}.json"


def target_key(path: str, sha256: str) -> str:
    """Returns the object-store key of a file in the update repository: TUF puts the hash before the name.

    Args:
        path: Path of the target.
        sha256: SHA-256 of its content, in hexadecimal digits.
    """
    folder, _, name = path.rpartition("/")
    return f"{FOLDER}/targets/{folder}/{sha256}.{name}"


TIMESTAMP_S = 0.25
"""Time for which the newest timestamp is cached, in seconds, as a whole fleet asks at once; publishers wait so long."""

_KEPT_METADATA = 64
_UNUSED_S = 86_400.0
_METADATA = re.compile(r"[1-9][0-9]{0,9}\.(root|targets|snapshot|application-[A-Za-z0-9_-]{1,255})\.json")
_TARGET = re.compile(r"applications/[A-Za-z0-9_-]{1,255}/[a-z]{1,32}/[A-Za-z0-9][A-Za-z0-9._-]{0,254}")


class RepositoryReader:
    """Reads files of the update repository for robots that ask for them; usable from any thread.

    Args:
        service: The service, with its catalog and object store.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._lock = threading.Lock()
        self._metadata: OrderedDict[str, bytes] = OrderedDict()
        self._timestamp = b""
        self._timestamp_until_s = 0.0
        self._fetching: dict[str, threading.Lock] = {}

    def metadata(self, name: str) -> bytes:
        """Reads a TUF metadata file, such as `timestamp.json` or `3.snapshot.json`.

        Raises:
            ObjectNotFoundError: The repository has no metadata file of this name.
            StorageError: The object store does not answer.
        """
        if name == "timestamp.json":
            return self._newest_timestamp()
        if not _METADATA.fullmatch(name):
            raise ObjectNotFoundError(f"there is no metadata {name[:60]!r}")
        with self._lock:
            if name in self._metadata:
                self._metadata.move_to_end(name)
                return self._metadata[name]
        content = self._get(f"{FOLDER}/metadata/{name}")
        with self._lock:
            self._metadata[name] = content
            while len(self._metadata) > _KEPT_METADATA:
                self._metadata.popitem(last=False)
        return content

    def target(self, path: str) -> Path:
        """Returns the local path of a file in the update repository, after downloading it if necessary.

        Args:
            path: Path of the target, with the hash before the name.

        Raises:
            ObjectNotFoundError: The repository has no such file.
            StorageError: The file cannot be downloaded.
        """
        if not _TARGET.fullmatch(path):
            raise ObjectNotFoundError(f"there is no target {path[:60]!r}")
        bucket, key = self._service.settings.bucket, f"{FOLDER}/targets/{path}"
        here = self._service.store.local_path(bucket, key)
        return here if here is not None else self._fetched(bucket, key, path)

    def _newest_timestamp(self) -> bytes:
        with self._lock:
            if time.monotonic() >= self._timestamp_until_s:
                self._timestamp = self._read_timestamp()
                self._timestamp_until_s = time.monotonic() + TIMESTAMP_S
            return self._timestamp

    def _read_timestamp(self) -> bytes:
        try:
            names = [info.key for info in self._service.store.list(self._service.settings.bucket, TIMESTAMPS)]
        except BucketNotFoundError as error:
            raise ObjectNotFoundError(str(error)) from error
        numbers = [name.removeprefix(TIMESTAMPS).removesuffix(".json") for name in names]
        newest = max((int(number) for number in numbers if number.isdecimal()), default=None)
        if newest is None:
            raise ObjectNotFoundError("nothing has been published for agents yet")
        return self._get(timestamp_key(newest))

    def _get(self, key: str) -> bytes:
        try:
            return self._service.store.get_bytes(self._service.settings.bucket, key)
        except BucketNotFoundError as error:
            raise ObjectNotFoundError(str(error)) from error

    def _fetched(self, bucket: str, key: str, path: str) -> Path:
        copy = self._service.folder("cache", "repository") / path.replace("/", "_")
        with self._lock:
            lock = self._fetching.setdefault(path, threading.Lock())
        with lock:
            if not copy.exists():
                self._remove_unused(copy.parent)
                self._service.store.get_file(bucket, key, copy)
        return copy

    def _remove_unused(self, folder: Path) -> None:
        """Deletes copies that were downloaded more than a day ago; open ones remain readable until they are closed."""
        before_s = time.time() - _UNUSED_S
        for copy in folder.iterdir():
            with suppress(FileNotFoundError):  # another process removed it
                if copy.stat().st_mtime < before_s:
                    copy.unlink()
