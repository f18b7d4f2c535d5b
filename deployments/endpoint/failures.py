"""What a client is told when a request fails: everything about its own mistakes, nothing about this machine."""

import logging

from ...schemas.errors import (
    InternalServerException,
    RobomakerError,
    ServiceError,
    ServiceUnavailableException,
    StorageError,
)
from ...schemas.operation_shape import OperationShape
from ...schemas.settings import Settings
from .messages import Headers, HttpAnswer, ProtocolError
from .wire import error_answer

LOGGER = logging.getLogger("robomaker.endpoint")


class Failures:
    """Turns whatever went wrong into answers.

    Args:
      settings: what they say of places on this machine is hidden from clients.
    """

    def __init__(self, settings: Settings) -> None:
        self._hidden = ((settings.object_store, "the object store"), (str(settings.home), "$ROBOMAKER_HOME"))

    def answer(
        self, error: Exception, operation: OperationShape | None, request_id: str, headers: Headers = ()
    ) -> HttpAnswer:
        """Tells the client what it can mend, and the log the rest.

        Args:
          error: what went wrong.
          operation: what was asked for, as far as that is known.
          request_id: the request's id; joins the answer to the log's line.
          headers: further headers.
        """
        if isinstance(error, ProtocolError):
            headers = (*headers, *error.headers)
        elif not isinstance(error, ServiceError) or error.status >= 500:
            return _broken(error, operation, request_id)
        message = str(error)
        for place, name in self._hidden:
            message = message.replace(place, name)
        return error_answer(error.code, error.status, message, headers=headers)


def _broken(error: Exception, operation: OperationShape | None, request_id: str) -> HttpAnswer:
    what = operation.name if operation else "a request"
    if isinstance(error, RobomakerError):
        LOGGER.error("%s failed (request %s): %s", what, request_id, error)
    else:
        LOGGER.error("%s failed (request %s)", what, request_id, exc_info=error)
    kind = _kind(error, operation)
    because = (
        "a part this call needs does not answer" if kind is ServiceUnavailableException else "something broke here"
    )
    return error_answer(kind.__name__, kind.status, f"{because}; the service's log says more under {request_id}")


def _kind(error: Exception, operation: OperationShape | None) -> type[ServiceError]:
    """503 where the operation declares it and it is true, else 500."""
    unavailable = isinstance(error, ServiceUnavailableException | StorageError)
    declared = operation is not None and ServiceUnavailableException in operation.errors
    return ServiceUnavailableException if unavailable and declared else InternalServerException
