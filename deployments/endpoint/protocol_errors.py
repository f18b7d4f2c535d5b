"""Errors that belong to the protocol alone: of requests that reach no operation."""

from ...schemas.wire.errors import RobomakerError

Headers = tuple[tuple[bytes, bytes], ...]


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
