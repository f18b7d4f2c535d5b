"""Requests and answers of HTTP as plain values, and the errors that belong to the protocol alone."""

from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass, replace
from typing import Any

from ...schemas.wire.errors import RobomakerError

ASGIScope = MutableMapping[str, Any]
ASGIReceive = Callable[[], Awaitable[MutableMapping[str, Any]]]
ASGISend = Callable[[MutableMapping[str, Any]], Awaitable[None]]
ASGIApplication = Callable[[ASGIScope, ASGIReceive, ASGISend], Awaitable[None]]

Headers = tuple[tuple[bytes, bytes], ...]


@dataclass(frozen=True)
class HttpRequest:
    """One request, read completely."""

    method: str
    raw_path: str
    """As it was sent, percent-encoded."""

    query: str
    """What follows the question mark, as it was sent."""

    headers: Headers
    """Names in small letters."""

    body: bytes = b""
    client: str = "-"
    """Address of who sent it, for the log."""

    def with_body(self, body: bytes) -> "HttpRequest":
        """The same request with its body."""
        return replace(self, body=body)

    def header(self, name: str) -> str | None:
        """The first header of a name, given in small letters."""
        return next(iter(self.all_headers(name)), None)

    def all_headers(self, name: str) -> list[str]:
        """All headers of a name, given in small letters."""
        wanted = name.encode()
        return [value.decode("latin-1") for key, value in self.headers if key == wanted]


@dataclass(frozen=True)
class HttpAnswer:
    """What is sent back."""

    status: int
    body: bytes
    content_type: bytes = b"application/json"
    headers: Headers = ()
    """Further headers."""

    error: str | None = None
    """Name of the error it tells of."""


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
    """The request comes from a web page."""

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
