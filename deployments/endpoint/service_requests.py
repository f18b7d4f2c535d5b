"""Requests as starlette reads them: with an id, and with path and query as they were sent."""

import random
import uuid

from starlette.requests import Request
from starlette.types import Receive, Scope

_CHANCE = random.Random()  # noqa: S311 - request ids are no secrets


class ServiceRequest(Request):
    """An HTTP request to the API server, with path and query in undecoded form."""

    content = b""
    """Body of an HTTP request, once it is read."""

    operation: str | None = None
    """Name of the requested API operation, once it is known."""

    def __init__(self, scope: Scope, receive: Receive) -> None:
        super().__init__(scope, receive)
        # Ids have to differ, not to be secret: no system call, after which this thread would wait for its turn again.
        self.id = str(uuid.UUID(int=_CHANCE.getrandbits(128), version=4))

    @property
    def raw_path(self) -> str:
        """Path of the request's URL, percent-encoded."""
        return self.scope["raw_path"].decode("latin-1")

    @property
    def raw_query(self) -> str:
        """Query string of the request's URL, undecoded."""
        return self.scope["query_string"].decode("latin-1")
