"""Client tokens: make Create and Start calls idempotent.

A caller that repeats a call with the same `clientRequestToken` gets the resource that the first call added, whatever
has changed since; the same token with another request is refused. Tokens belong to the access key that called: another
one learns nothing of them. The catalog stores the token in the transaction
that adds the resource, and forgets it when the resource is deleted.

```
token = ClientToken.of("CreateSimulationJob", request)    in the handler, before anything else is checked
service.find_by_client_token(token)                       the resource of the first call, if there was one
catalog.create(resource, token=token)                     adds both, or returns the resource of the first call
```
"""

import hashlib
import json
from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from sqlalchemy import Connection, bindparam, insert, select

from ...schemas.wire.base import Shape
from ...schemas.wire.errors import IdempotentParameterMismatchException
from .queries import one_row, resource_of
from .records import Resource
from .tables import client_tokens

_EARLIER = select(client_tokens.c.request_hash, client_tokens.c.arn).where(
    client_tokens.c.operation == bindparam("called"),
    client_tokens.c.account == bindparam("by"),
    client_tokens.c.token == bindparam("given"),
)


_OWNER: ContextVar[str] = ContextVar("owner of client tokens", default="")


@contextmanager
def tokens_of(owner: str) -> Generator[None]:
    """Sets the owner of client tokens inside a `with` block, so that equal tokens of two callers do not collide.

    Args:
        owner: An access key or a job; empty: a caller without either.
    """
    before = _OWNER.set(owner)
    try:
        yield
    finally:
        _OWNER.reset(before)


@dataclass(frozen=True)
class ClientToken:
    """A caller's idempotency token, with its operation, a hash of its request, and its owner."""

    operation: str
    """The operation's name; tokens of different operations have nothing to do with each other."""

    token: str
    """Client token (idempotency token) as the caller sent it."""

    request_hash: str
    """Hash of the request with a client token; equal for equal requests."""

    owner: str = ""
    """Owner of the token: an access key or a job; empty: a caller without either."""

    @property
    def stored(self) -> str:
        """Key under which the catalog stores the token; it contains the token's owner."""
        return hashlib.sha256(f"{self.owner}\0{self.token}".encode()).hexdigest() if self.owner else self.token

    @classmethod
    def of(cls, operation: str, request: Shape) -> "ClientToken | None":
        """Returns the token in a request's `clientRequestToken`, with a hash of the request; `None` if it has none."""
        members = request.model_dump(mode="json", exclude_none=True)
        token = members.pop("clientRequestToken", None)
        if token is None:
            return None
        canonical = json.dumps(members, sort_keys=True, separators=(",", ":"))
        return cls(operation, token, hashlib.sha256(canonical.encode()).hexdigest(), _OWNER.get())

    @classmethod
    def of_batch_job(cls, batch_id: str, index: int) -> "ClientToken":
        """Makes the token for request number `index` of a batch, so that several workers create only one job for it."""
        return cls("StartSimulationJobBatch", f"{batch_id}-{index}", request_hash="")


def find_resource(connection: Connection, token: ClientToken, account: str) -> Resource | None:
    """Returns the resource that an earlier call of the same account with the same client token created, else `None`.

    Raises:
        IdempotentParameterMismatchException: The earlier call with this client token had another request.
    """
    meant = {"called": token.operation, "by": account, "given": token.stored}
    earlier = connection.execute(_EARLIER, meant).mappings().one_or_none()
    if earlier is None:
        return None
    if earlier["request_hash"] != token.request_hash:
        raise IdempotentParameterMismatchException(
            f"clientRequestToken {token.token!r} was used for {earlier['arn']} with another request; use a new token"
        )
    return resource_of(one_row(connection, earlier["arn"]))


def store_token(connection: Connection, token: ClientToken, account: str, arn: str) -> None:
    """Stores in the catalog the client token of the call that created the resource `arn`, in the same transaction."""
    connection.execute(
        insert(client_tokens).values(
            operation=token.operation, account=account, token=token.stored, request_hash=token.request_hash, arn=arn
        )
    )
