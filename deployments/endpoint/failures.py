"""Error responses: complete about the client's mistakes, silent about this machine."""

import logging
import re
from collections.abc import Iterator
from pathlib import Path

from starlette.responses import Response

from ...schemas.settings import Settings
from ...schemas.wire.errors import (
    InternalServerException,
    RobomakerError,
    ServiceError,
    ServiceUnavailableException,
    StorageError,
)
from ...schemas.wire.operation_shape import OperationShape
from .protocol_errors import ProtocolError
from .wire import error_response

LOGGER = logging.getLogger("robomaker.endpoint")


class Failures:
    """Converts exceptions of the API server to HTTP responses.

    Args:
        settings: Settings whose paths and addresses are hidden from clients.
    """

    def __init__(self, settings: Settings) -> None:
        self._hidden = tuple(_hidden(settings))

    def answer(self, error: Exception, operation: OperationShape | None, request_id: str) -> Response:
        """Makes the error response for the client, and logs details.

        Args:
            error: The error that occurred.
            operation: Name of the operation, if it is known.
            request_id: The request's id; joins the answer to the log's line.
        """
        is_protocol = isinstance(error, ProtocolError)
        if not is_protocol and (not isinstance(error, ServiceError) or error.status >= 500):
            return _broken(error, operation, request_id)
        response = error_response(error.code, error.status, self.told(error))
        if is_protocol:
            response.raw_headers += error.headers
        return response

    def told(self, error: Exception) -> str:
        """Returns an error's message with paths of this machine removed."""
        message = str(error)
        for place, name in self._hidden:
            message = place.sub(name, message)
        return message


def _hidden(settings: Settings) -> Iterator[tuple[re.Pattern[str], str]]:
    """Yields patterns of paths of this machine in messages, and the texts that replace them for clients."""
    store = settings.object_store
    if "://" in store:
        yield re.compile(re.escape(store.rstrip("/"))), "the object store"
    elif store != "aws":
        yield _folder(Path(store).expanduser().absolute()), "the object store"
    yield _folder(settings.home), "$ROBOMAKER_HOME"


def _folder(path: Path) -> re.Pattern[str]:
    """Returns a pattern that matches a folder, but not its name within another path.

    The pattern of `/data` does not match in `s3://bucket/data`.
    """
    return re.compile(rf"(?:(?<=file://)|(?<![\w./-])){re.escape(str(path))}(?![\w-])")


def _broken(error: Exception, operation: OperationShape | None, request_id: str) -> Response:
    what = operation.name if operation else "a request"
    if isinstance(error, RobomakerError):
        LOGGER.error("%s failed (request %s): %s", what, request_id, error)
    else:
        LOGGER.error("%s failed (request %s)", what, request_id, exc_info=error)
    kind = _kind(error, operation)
    because = (
        "a part this call needs does not answer" if kind is ServiceUnavailableException else "something broke here"
    )
    return error_response(kind.__name__, kind.status, f"{because}; the service's log says more under {request_id}")


def _kind(error: Exception, operation: OperationShape | None) -> type[ServiceError]:
    """Returns the class of an error response: 503 if the operation declares it and it applies, else 500."""
    unavailable = isinstance(error, ServiceUnavailableException | StorageError)
    declared = operation is not None and ServiceUnavailableException in operation.errors
    return ServiceUnavailableException if unavailable and declared else InternalServerException
