"""Requests as starlette reads them, and the errors that belong to the protocol alone."""

import random
import uuid

from starlette.requests import Request
from starlette.types import Receive, Scope

from ...schemas.wire.errors import RobomakerError

Headers = tuple[tuple[bytes, bytes], ...]

_CHANCE = random.Random()  # noqa: S311 - request ids are no secrets


class ServiceRequest(Request):
    """One request; signatures and ARNs in paths need both parts of its target as they were sent."""

    content = b""
    """The body, once it is read."""

    operation: str | None = None
    """The operation that it asks for, once that is known."""

    def __init__(self, scope: Scope, receive: Receive) -> None:
        super().__init__(scope, receive)
        # Ids have to differ, not to be secret: no system call, after which this thread would wait for its turn again.
        self.id = str(uuid.UUID(int=_CHANCE.getrandbits(128), version=4))

    @property
    def raw_path(self) -> str:
        """The path, percent-encoded."""
        return self.scope["raw_path"].decode("latin-1")

    @property
    def raw_query(self) -> str:
        """Query string of the URL: all after the question mark."""
        return self.scope["query_string"].decode("latin-1")


class ProtocolError(RobomakerError):
    """A request that no operation sees; class name and `status` are those of the wire."""

    status = 400
    exit_code = 2
    headers: Headers = ()

    @property
    def code(self) -> str:
        """The error's name, as SDKs read it."""
        return type(self).__name__


class SerializationException(ProtocolError):
    """The body, the path or the query cannot be read."""


class RequestTimeoutException(ProtocolError):
    """The body did not arrive in time."""

    status = 408


class RequestEntityTooLargeException(ProtocolError):
    """The body is longer than anything the service takes."""

    status = 413


class UnsupportedMediaTypeException(ProtocolError):
    """The body says that it is something else than JSON."""

    status = 415


class UnknownOperationException(ProtocolError):
    """There is nothing at the path."""

    status = 404


class MethodNotAllowedException(UnknownOperationException):
    """There is something at the path, but not with this method; on the wire an unknown operation."""

    status = 405

    def __init__(self, message: str, allowed: tuple[str, ...]) -> None:
        self.headers = ((b"allow", ", ".join(allowed).encode()),)
        super().__init__(message)

    @property
    def code(self) -> str:
        """The error's name, as SDKs read it."""
        return UnknownOperationException.__name__


class AccessDeniedException(ProtocolError):
    """The request comes from a web page, or its access key is not good for it."""

    status = 403


class MissingAuthenticationTokenException(ProtocolError):
    """The request is not signed."""

    status = 403


class IncompleteSignatureException(ProtocolError):
    """The signature lacks a part, or signs too little."""

    status = 403


class UnrecognizedClientException(ProtocolError):
    """There is no such access key."""

    status = 403


class InvalidSignatureException(ProtocolError):
    """The signature is not that of the request, or too old."""

    status = 403
