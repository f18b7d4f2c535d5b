"""Object store with the rights of an access role, restricted here where no server does it."""

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ....schemas.roles import Role, find_role, is_within
from ....schemas.settings import Settings
from ....schemas.wire.errors import CredentialsRefusedError, StorageAccessDeniedError
from ..configured_store import s3_endpoint
from ..directory import DirectoryStore
from ..object_store import ObjectInfo, ObjectStore, Result, StoreOver
from .roles_file import Keys, ReadBlock, read_roles_file

if TYPE_CHECKING:
    from boto3 import Session


class ConfinedStore(StoreOver):
    """Object store wrapper that refuses accesses which an access role does not allow.

    Args:
        store: The store behind it.
        role: The access role, with the keys that may be read and written.
        arn: The ARN of the request, for messages.
    """

    def __init__(self, store: ObjectStore, role: Role, arn: str) -> None:
        super().__init__(store)
        self._places = {"read": (*role.read, *role.write), "write": role.write}
        self._arn = arn

    def do(
        self, access: Literal["read", "write"], bucket: str, keys: Iterable[str], call: Callable[[], Result]
    ) -> Result:
        """Calls the wrapped store and returns the result, if the role allows the access to all keys.

        Raises `StorageAccessDeniedError` if it does not.
        """
        for key in keys:
            if not is_within(self._places[access], bucket, key):
                raise self._denied(f"{access} {bucket}/{key}", access)
        return call()

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """Lists the wrapped store's objects with a prefix that the role may read, one by one; see `ObjectStore`."""
        return self.do("read", bucket, [prefix], lambda: self.behind.list(bucket, prefix))

    def ensure_bucket(self, bucket: str) -> None:
        """Creates a bucket unless it exists, if the role may write to some of it; see `ObjectStore`.

        Raises `StorageAccessDeniedError` if it may not.
        """
        if not any(place.startswith(f"{bucket}/") for place in self._places["write"]):
            raise self._denied(f"make the bucket {bucket}", "write")
        self.behind.ensure_bucket(bucket)

    def local_path(self, bucket: str, key: str) -> Path | None:
        """Returns the local file of an object, `None` if the role may not read it or it has none; see `ObjectStore`."""
        return self.behind.local_path(bucket, key) if is_within(self._places["read"], bucket, key) else None

    def _denied(self, what: str, member: str) -> StorageAccessDeniedError:
        return StorageAccessDeniedError(
            f"role {self._arn} may not {what}; `{member}` of the roles file has no such place"
        )


def _no_blocks(slug: str, name: str) -> None:
    """Raises `CredentialsRefusedError` for credentials in a Prefect block, as no function to read blocks was given."""
    raise CredentialsRefusedError(f"the block {slug}/{name} cannot be read here: this process does not use Prefect")


@dataclass
class _Opened:
    """Cache of the stores and sessions that were opened for roles, by ARN; shared by all threads of a process."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    stores: dict[str, ObjectStore] = field(default_factory=dict[str, ObjectStore])
    sessions: "dict[str, Session]" = field(default_factory=lambda: dict[str, "Session"]())


@dataclass(frozen=True)
class Roles:
    """All access roles of a service, with their object stores and credentials, opened on first use.

    The credentials of an opened role are kept until this process ends; those of an assumed role are renewed.
    """

    roles: Sequence[Role]
    own_store: ObjectStore
    """Object store of this process, of which roles on a directory get a restricted view."""

    settings: Settings
    environ: Mapping[str, str]
    """Environment variables with the credentials that assume roles."""

    read_block: ReadBlock = _no_blocks
    opened: _Opened = field(default_factory=_Opened)

    def with_blocks(self, read_block: ReadBlock) -> "Roles":
        """Returns a copy of the roles that reads credentials in Prefect blocks with the given function."""
        return replace(self, read_block=read_block)

    def store_of(self, arn: str) -> ObjectStore:
        """Returns the object store as a role may access it.

        Args:
            arn: The role, as the request names it.

        Raises:
            CredentialsRefusedError: The role does not exist, or its credentials are refused.
            StorageUnavailableError: The server does not answer.
        """
        with self.opened.lock:
            if arn not in self.opened.stores:
                self.opened.stores[arn] = self._open(arn)
            return self.opened.stores[arn]

    def keys_of(self, arn: str) -> Keys | None:
        """Returns a role's current credentials; `None` if objects are local files.

        Raises:
            StorageError: The role does not exist, its credentials are refused or cannot be renewed, or the server does
                not answer.
        """
        self.store_of(arn)
        session = self.opened.sessions.get(arn)
        if session is None:
            return None
        from .sessions import keys_of

        return keys_of(session)

    def _open(self, arn: str) -> ObjectStore:
        role = find_role(self.roles, arn)
        if role is None:
            raise CredentialsRefusedError(f"role {arn} is not in the roles file, so no job may act as it")
        if isinstance(self.own_store, DirectoryStore):
            return ConfinedStore(self.own_store, role, arn)
        from ..s3 import S3Store
        from .sessions import SessionSource

        endpoint, region = s3_endpoint(self.settings), self.settings.region
        session = SessionSource(endpoint, region, self.environ, self.read_block).session_of(role, arn)
        store = S3Store(endpoint, region, session)
        store.check_credentials()
        self.opened.sessions[arn] = session
        return store


def open_roles(settings: Settings, store: ObjectStore, environ: Mapping[str, str]) -> Roles | None:
    """Opens the roles file that the settings name; `None` if they name none.

    Args:
        settings: `roles_file`, `object_store` and `region` are used.
        store: The process's own store.
        environ: Environment variables, usually `os.environ`.

    Raises:
        ConfigurationError: The file cannot be used.
    """
    if settings.roles_file is None:
        return None
    return Roles(read_roles_file(settings.roles_file), store, settings, environ)
