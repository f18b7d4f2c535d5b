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
from .messages import Headers, HttpAnswer, ProtocolError
from .wire import error_answer

LOGGER = logging.getLogger("robomaker.endpoint")


def failure_answer(
    error: Exception, operation: OperationShape | None, request_id: str, headers: Headers = ()
) -> HttpAnswer:
    """Turns whatever went wrong into an answer; what the client cannot mend is told to the log.

    Args:
      error: what went wrong.
      operation: what was asked for, as far as that is known.
      request_id: the request's id; joins the answer to the log's line.
      headers: further headers.
    """
    if isinstance(error, ProtocolError) or (isinstance(error, ServiceError) and error.status < 500):
        if isinstance(error, ProtocolError):
            headers = (*headers, *error.headers)
        return error_answer(error.code, error.status, str(error), headers=headers)
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
