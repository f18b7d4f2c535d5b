"""HTTP requests to the API server, and protocol errors."""

import random
import uuid

from starlette.requests import Request
from starlette.types import Receive, Scope

from ...schemas.wire.errors import RobomakerError

Headers = tuple[tuple[bytes, bytes], ...]

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


class ProtocolError(RobomakerError):
    """Base class of errors in requests that no operation sees; class name and HTTP `status` are AWS's."""

    status = 400
    exit_code = 2
    headers: Headers = ()

    @property
    def code(self) -> str:
        """Error code in the response, by which AWS SDKs choose the exception."""
        return type(self).__name__


class SerializationException(ProtocolError):
    """Request error: body, path or query cannot be parsed."""


class RequestTimeoutException(ProtocolError):
    """Request error: the body did not arrive in time."""

    status = 408


class RequestEntityTooLargeException(ProtocolError):
    """Request error: the body is too long."""

    status = 413


class UnsupportedMediaTypeException(ProtocolError):
    """Request error: the body's content type is not JSON."""

    status = 415


class UnknownOperationException(ProtocolError):
    """Request error: no operation has this path."""

    status = 404


class MethodNotAllowedException(UnknownOperationException):
    """Request error: the path exists, but not with this HTTP method."""

    status = 405

    def __init__(self, message: str, allowed: tuple[str, ...]) -> None:
        self.headers = ((b"allow", ", ".join(allowed).encode()),)
        super().__init__(message)

    @property
    def code(self) -> str:
        """Error code in the response, by which AWS SDKs choose the exception."""
        return UnknownOperationException.__name__


class AccessDeniedException(ProtocolError):
    """Request error: it comes from a web page, or its access key lacks the right."""

    status = 403


class MissingAuthenticationTokenException(ProtocolError):
    """Request error: the request is not signed."""

    status = 403


class IncompleteSignatureException(ProtocolError):
    """Request error: the signature lacks a part, or covers too little."""

    status = 403


class UnrecognizedClientException(ProtocolError):
    """Request error: the access key does not exist."""

    status = 403


class InvalidSignatureException(ProtocolError):
    """Request error: the signature is wrong or too old."""

    status = 403
