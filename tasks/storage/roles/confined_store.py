"""An object store confined to the places of a role: what a server's policies do where there is no server."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

from ....schemas.roles import Role, is_within
from ....schemas.wire.errors import StorageAccessDeniedError
from ..base import ObjectStore, Result, StoreOver


class ConfinedStore(StoreOver):
    """An `ObjectStore` that refuses all that a role may not do, with `StorageAccessDeniedError`.

    Args:
        store: the store behind it.
        role: what may be read and written.
        arn: the ARN of the request, for messages.
    """

    def __init__(self, store: ObjectStore, role: Role, arn: str) -> None:
        super().__init__(store)
        self._places = {"read": (*role.read, *role.write), "write": role.write}
        self._arn = arn

    def do(
        self, access: Literal["read", "write"], bucket: str, keys: Iterable[str], call: Callable[[], Result]
    ) -> Result:
        """Calls the store behind this one for what is in the role's places."""
        for key in keys:
            if not is_within(self._places[access], bucket, key):
                raise self._denied(f"{access} {bucket}/{key}", access)
        return call()

    def ensure_bucket(self, bucket: str) -> None:
        """See `ObjectStore`; some of the bucket has to be the role's to write to."""
        if not any(place.startswith(f"{bucket}/") for place in self._places["write"]):
            raise self._denied(f"make the bucket {bucket}", "write")
        self.behind.ensure_bucket(bucket)

    def local_path(self, bucket: str, key: str) -> Path | None:
        """See `ObjectStore`; `None` for what the role may not read."""
        return self.behind.local_path(bucket, key) if is_within(self._places["read"], bucket, key) else None

    def _denied(self, what: str, member: str) -> StorageAccessDeniedError:
        return StorageAccessDeniedError(
            f"role {self._arn} may not {what}; `{member}` of the roles file has no such place"
        )
