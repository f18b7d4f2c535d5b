"""Calls of operations: within what the caller's access key is good for, and told to job worker and audit log."""

import logging
from collections.abc import Callable, Mapping
from typing import Any

from ....schemas.wire.base import Shape
from ....schemas.wire.errors import InternalServerException
from ....tasks.catalog import tokens_of
from ....tasks.operations.registry import Operation, registry
from ....tasks.service.service import Service
from .audit_log import AuditLog, Call
from .scopes import check_resources, check_scope, named_resources, only_visible

LOGGER = logging.getLogger("robomaker.endpoint")


class Calls:
    """Makes calls.

    Args:
        service: where the operations happen.
        on_submitted: told the ARN of every job that was stored.
        audit_log: is told of every call, also of refused ones; `None`: there is none.
    """

    def __init__(
        self, service: Service, on_submitted: Callable[[str], None], audit_log: AuditLog | None = None
    ) -> None:
        self._service = service
        self._on_submitted = on_submitted
        self._audit_log = audit_log

    def make(self, name: str, members: Mapping[str, Any], call: Call) -> dict[str, Any]:
        """Calls an operation for a caller who is known, and writes it down.

        Args:
            name: the operation.
            members: of its request.
            call: who calls; gets what was called, and how it ended.

        Raises:
            AccessDeniedException: the caller's access key is not good for it.
            ServiceError: the request is refused.
        """
        operation = registry()[name]
        call.operation = name
        try:
            if call.key is not None:
                check_scope(call.key, name)
            return self.answer(operation, operation.checked(members, self._service), call)
        except Exception as error:
            call.outcome = getattr(error, "code", InternalServerException.__name__)
            raise
        finally:
            self.write(call)

    def answer(self, operation: Operation, checked: Shape, call: Call) -> dict[str, Any]:
        """Carries out a checked request of a caller whose scope was checked.

        Raises:
            AccessDeniedException: the request names what the caller's access key is not good for.
            ServiceError: the request is refused.
        """
        shape, key, catalog = operation.shape, call.key, self._service.catalog
        if key is not None or self._audit_log is not None:
            wire = checked.to_wire()
            call.resources = list(named_resources(wire))
            if key is not None:
                check_resources(key, shape, wire, catalog)
        with tokens_of(key.id if key is not None else call.job or ""):
            answer = operation.handle(checked, self._service)
        call.resources = [*filter(None, [answer.get("arn")]), *call.resources]
        if shape.is_job:
            self._tell(answer["arn"], call.request_id)
        return answer if key is None else only_visible(key, shape, answer, catalog)

    def write(self, call: Call) -> None:
        """Adds a call to the audit log, if there is one."""
        if self._audit_log is not None:
            self._audit_log.write(call)

    def _tell(self, arn: str, request_id: str) -> None:
        try:
            self._on_submitted(arn)
        except Exception:
            # The job is stored, and a job worker finds it in the catalog later.
            LOGGER.exception("no job worker could be told of %s (request %s)", arn, request_id)
