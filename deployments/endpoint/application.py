"""API endpoint as an ASGI application, with its access log."""

import asyncio
import logging
import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from opentelemetry.trace import Span
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from ...schemas.wire.errors import ThrottlingException
from ...schemas.wire.operation_shape import OperationShape
from ...tasks.operations.registry import registry
from ...tasks.service.service import Service
from ...tasks.service.spans import span
from ..log_lines import log_formatter
from .calling.access_keys import AccessKey
from .calling.audit_log import AuditLog, Call
from .calling.authentication import Authenticator, Signer, is_repeatable
from .calling.job_callers import JobCallers
from .calling.scopes import Calls, check_scope
from .failures import Failures
from .health import PATH as METRICS
from .health import HealthPages, Metrics
from .origins import check_origin
from .other_services import refused
from .protocol_errors import AccessDeniedException
from .request_bodies import Arrivals, read_body
from .service_requests import ServiceRequest
from .wire import MAX_BODY_BYTES, Route, Router, WireResponse, request_members

LOGGER = logging.getLogger("robomaker.access")
LOGGER.propagate = False  # nothing is written, and nothing costs time, until `write_access_log`


def write_access_log(path: Path | None = None) -> logging.Handler:
    """Starts the HTTP access log of the API server.

    Args:
        path: File that lines are added to; `None`: standard error.

    Returns:
        The handler; closing it is the caller's.

    Raises:
        OSError: The file cannot be written.
    """
    handler = logging.StreamHandler() if path is None else logging.FileHandler(path, encoding="utf-8")
    formatter = log_formatter(os.environ, "%(asctime)s %(message)s", "%Y-%m-%dT%H:%M:%SZ")
    formatter.converter = time.gmtime
    handler.setFormatter(formatter)
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    return handler


def log_access(request: ServiceRequest, status: int, error: str, duration_s: float) -> None:
    """Logs one HTTP request, if the access log is on.

    Args:
        request: The HTTP request.
        status: HTTP status of the answer.
        error: Name of the error that it tells of; `-`: of none.
        duration_s: Duration of the request, in seconds.
    """
    if LOGGER.handlers:
        LOGGER.info(
            "%s %s %s %d %s %.1f ms %s",
            request.client.host if request.client else "-",
            ascii(request.method)[1:-1],
            ascii(request.raw_path)[1:-1][:500],
            status,
            error,
            duration_s * 1000,
            request.id,
            # What lines of JSON have besides.
            extra={
                "operation": request.operation,
                "status": status,
                "duration_ms": round(duration_s * 1000, 1),
                "request_id": request.id,
            },
        )


# SQLite reads in parallel, but Python runs one thread at a time: more threads only wait for each other.
WORKERS = 8
MAX_IN_PROGRESS = 128
"""Limit of API requests at once; clients above it are asked to try again later."""

RETRY_AFTER_S = 1


def ignore(arn: str) -> None:
    """Does nothing: the default listener for submitted jobs."""


class Endpoint:
    """API server: the ASGI application that serves every RoboMaker operation over HTTP.

    Args:
        service: The service, with its catalog and object store.
        access_keys: Access keys by id; `None`: requests need no signature, and web pages are refused.
        on_submitted: Called with the ARN of every stored job, again if the call is repeated;
            from several threads, before the client has its answer.
        worker_status: Returns the job worker's status for the health page; plain JSON.
        audit_log: Records every call of an operation, also refused ones.
        console: Path of the console beside it, which the status page leads to; `None`: there is none.
    """

    def __init__(
        self,
        service: Service,
        *,
        access_keys: Mapping[str, AccessKey] | None = None,
        on_submitted: Callable[[str], None] = ignore,
        worker_status: Callable[[], Mapping[str, object]] = dict,
        audit_log: AuditLog | None = None,
        console: str | None = None,
    ) -> None:
        settings = service.settings
        self.checks_signatures = access_keys is not None
        """Whether API requests must be signed."""

        self._service = service
        self._operations = registry()
        self._router = Router(each.shape for each in self._operations.values())
        self._authenticator = (
            None if access_keys is None else Authenticator(access_keys, settings.region, service.clock)
        )
        self.calls = Calls(service, on_submitted, audit_log)
        """Caller of operations, which the console uses, too."""

        self.job_callers = None if self.checks_signatures else JobCallers(service)
        """Recogniser of requests that jobs send; `None`: signatures identify callers."""

        self._health = HealthPages(service, worker_status, is_open=access_keys is None, console=console)
        self._metrics = Metrics(service, access_keys, worker_status)
        self._failures = Failures(settings)
        self._workers = ThreadPoolExecutor(WORKERS, thread_name_prefix="endpoint")
        self._arrivals = Arrivals()
        self._in_progress = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one HTTP request, or the server's start and end (ASGI)."""
        if scope["type"] == "http":
            await self._serve(ServiceRequest(scope, receive), send)
        elif scope["type"] == "lifespan":
            await self._live(receive, send)

    async def _live(self, receive: Receive, send: Send) -> None:
        while (message := await receive())["type"] != "lifespan.shutdown":
            await send({"type": f"{message['type']}.complete"})
        await asyncio.to_thread(self._workers.shutdown)
        await send({"type": "lifespan.shutdown.complete"})

    async def _serve(self, request: ServiceRequest, send: Send) -> None:
        began = time.perf_counter()
        try:
            response = await self._answer(request)
        except ClientDisconnect:
            return
        response.raw_headers += [(b"x-amzn-requestid", request.id.encode()), (b"x-content-type-options", b"nosniff")]
        if request.method == "HEAD":
            response.body = b""
        await response(request.scope, request.receive, send)
        error = response.headers.get("x-amzn-errortype", "-")
        self.note(request, response.status_code, time.perf_counter() - began, error)

    def note(self, request: ServiceRequest, status: int, duration_s: float, error: str = "-") -> None:
        """Counts and logs an answered request.

        Args:
            request: The HTTP request.
            status: HTTP status of the answer.
            duration_s: Duration of the request, in seconds.
            error: Name of the error that the answer tells of; `-`: of none.
        """
        self._metrics.count(request.operation, status, duration_s)
        log_access(request, status, error, duration_s)

    async def _answer(self, request: ServiceRequest) -> Response:
        # Without either header there is no body.
        headers = request.headers
        declared = headers.get("content-length") or (None if headers.get("transfer-encoding") else "0")
        try:
            # Bodies that are still being sent do not count as requests: slow senders keep no other client out.
            with self._arrivals.admitted(declared) as timeout_s:
                request.content = await read_body(request, declared, MAX_BODY_BYTES, timeout_s)
            if self._in_progress >= MAX_IN_PROGRESS:
                raise ThrottlingException(f"{MAX_IN_PROGRESS} requests are in progress")
        except ClientDisconnect:
            raise
        except ThrottlingException as error:
            patient = ThrottlingException(f"{error}; try again in {RETRY_AFTER_S} s")
            response = self._failures.answer(patient, None, request.id)
            response.headers["retry-after"] = str(RETRY_AFTER_S)
            return response
        except Exception as error:
            return refused(request) or self._failures.answer(error, None, request.id)
        self._in_progress += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._workers, self._answer_request, request)
        finally:
            self._in_progress -= 1

    def _answer_request(self, request: ServiceRequest) -> Response:
        """Answers an API request; in a thread of its own, since operations wait for the database."""
        with span("request", traceparent=request.headers.get("traceparent"), request_id=request.id) as current:
            answer = self._answered(request, current)
            current.set_attribute("http.response.status_code", answer.status_code)
        return answer

    def _answered(self, request: ServiceRequest, current: Span) -> Response:
        if (refusal := refused(request)) is not None:
            return refusal
        operation: OperationShape | None = None
        call = Call(request.id, request.client.host if request.client else None)
        try:
            if self._authenticator is None:
                check_origin(request)
            call.job = self._job_of(request)
            if (page := self._page(request, is_of_job=call.job is not None)) is not None:
                return page
            signer = self._authenticator.check(request) if self._authenticator is not None else None
            call.key = signer and signer.key
            route = self._router.find(request.method, request.raw_path)
            operation = route.operation
            request.operation = call.operation = operation.name
            current.update_name(operation.name)
            answer = self._called(route, request, signer, call)
            if operation.is_job and call.resources:
                current.set_attribute("robomaker.arn", call.resources[0])
        except Exception as error:
            answer = self._failures.answer(error, operation, request.id)
            call.outcome = answer.headers["x-amzn-errortype"]
        self.calls.write(call)
        return answer

    def _job_of(self, request: ServiceRequest) -> str | None:
        """Returns the ARN of the job that sent a request; `None`: no job did, or signatures identify the caller."""
        if self.job_callers is None:
            return None
        return self.job_callers.job_of_path(request.scope) or self.job_callers.job_of(request.scope)

    def _page(self, request: ServiceRequest, *, is_of_job: bool) -> Response | None:
        """Returns the health or metrics page that a request asks for; `None` if it asks for neither.

        A job learns only that the service works: raises AccessDeniedException if a job asks for metrics.
        """
        if is_of_job and request.raw_path == METRICS:
            raise AccessDeniedException("a simulation job sent this request, and metrics are not for jobs")
        return self._health.answer(request, is_of_job=is_of_job) or self._metrics.answer(request)

    def _called(self, route: Route, request: ServiceRequest, signer: Signer | None, call: Call) -> Response:
        shape = route.operation
        operation = self._operations[shape.name]
        if call.key is not None:
            check_scope(call.key, shape.name)
        members = request_members(route, request)
        if signer is not None and self._authenticator is not None:
            self._authenticator.use(signer, repeatable=is_repeatable(shape.name, members))
        checked = operation.checked(members, self._service)
        if call.job is not None and self.job_callers is not None:
            self.job_callers.check(call.job, shape, checked.to_wire())
        return WireResponse(self.calls.answer(operation, checked, call))
