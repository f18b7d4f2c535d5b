"""The object store as a role has it."""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ....schemas.roles import Role, find_role
from ....schemas.settings import Settings
from ....schemas.wire.errors import CredentialsRefusedError
from ..base import ObjectStore
from ..directory import DirectoryStore
from ..opening import s3_endpoint
from .confined_store import ConfinedStore
from .keys import Keys, ReadBlock
from .reading import read_roles_file

if TYPE_CHECKING:  # only who uses S3 waits for its import
    from boto3 import Session


def _no_blocks(slug: str, name: str) -> None:
    """Refuses a block of Prefect, where nothing that knows Prefect has been passed in."""
    raise CredentialsRefusedError(f"the block {slug}/{name} cannot be read here: this process does not use Prefect")


@dataclass
class _Opened:
    """Stores and sessions opened for roles, by ARN; shared by all threads of a process."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    stores: dict[str, ObjectStore] = field(default_factory=dict[str, ObjectStore])
    sessions: "dict[str, Session]" = field(default_factory=lambda: dict[str, "Session"]())


@dataclass(frozen=True)
class Roles:
    """The roles of a service, whose stores and credentials are opened when they are first asked for.

    A role that was opened keeps its credentials until this process ends; those of an assumed role are had again.
    """

    roles: Sequence[Role]
    own_store: ObjectStore
    """This process's own store, which the directory of a role is confined in."""

    settings: Settings
    environ: Mapping[str, str]
    """Environment variables: roles are assumed with the credentials that these name."""

    read_block: ReadBlock = _no_blocks
    opened: _Opened = field(default_factory=_Opened)

    def with_blocks(self, read_block: ReadBlock) -> "Roles":
        """The same roles, whose blocks of Prefect can be read."""
        return replace(self, read_block=read_block)

    def store_of(self, arn: str) -> ObjectStore:
        """The object store as a role has it.

        Args:
            arn: the role, as the request names it.

        Raises:
            CredentialsRefusedError: there is no such role, or its credentials are no good.
            StorageUnavailableError: the server does not answer.
        """
        with self.opened.lock:
            if arn not in self.opened.stores:
                self.opened.stores[arn] = self._open(arn)
            return self.opened.stores[arn]

    def keys_of(self, arn: str) -> Keys | None:
        """A role's credentials as they are now; `None`: objects are files, for which there are none.

        Raises:
            StorageError: see `store_of`; or they cannot be had again.
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
    """The roles of the file that the settings name; `None`: they name none.

    Args:
        settings: `roles_file`, `object_store` and `region` are used.
        store: the process's own store.
        environ: environment variables, usually `os.environ`.

    Raises:
        ConfigurationError: the file cannot be used.
    """
    if settings.roles_file is None:
        return None
    return Roles(read_roles_file(settings.roles_file), store, settings, environ)
