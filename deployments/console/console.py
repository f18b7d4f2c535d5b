"""Web console as an ASGI application in front of the API endpoint, and the URLs of its pages."""

import logging
import re
import secrets
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from http import HTTPStatus

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route, compile_path
from starlette.types import Message, Receive, Scope, Send

from ...schemas.discovery import modules_of
from ...schemas.wings import parts_of_wings
from ...schemas.wire.errors import (
    ConfigurationError,
    ObjectNotFoundError,
    ResourceNotFoundException,
    RobomakerError,
    ServiceError,
    StorageUnavailableError,
    ThrottlingException,
)
from ...tasks.service.service import Service
from ..endpoint.application import Endpoint
from ..endpoint.calling.access_keys import AccessKey
from ..endpoint.failures import Failures
from ..endpoint.origins import is_local_host
from ..endpoint.protocol_errors import AccessDeniedException, ProtocolError
from ..endpoint.service_requests import ServiceRequest
from ..foreign_pages import refusal
from ..spec_runs.spec_runs import SpecRuns
from . import batches, jobs, login, overview, pages, runs
from .batch_caches import BatchBriefs, JobLines, Posters
from .files import published
from .orders import ordered_runs, run_starts, worlds_form
from .orders.forms import read_fields
from .rendering import FOLDERS, HOME, MENU, address, asset, render
from .sessions import Sessions
from .streams import Streams
from .timelines import job_timelines
from .visit import Context, Visit

_ACTS = {
    ("jobs", "cancel"): ("CancelSimulationJob", "job"),
    ("jobs", "restart"): ("RestartSimulationJob", "job"),
    ("batches", "cancel"): ("CancelSimulationJobBatch", "batch"),
    ("generations", "cancel"): ("CancelWorldGenerationJob", "job"),
}
"""Operation of each form, and the member that takes the resource's ARN, by the form's URL parts."""

_OTHERS: Mapping[tuple[str, str], Callable[[Visit], Response]] = {
    ("runs", "cancel"): ordered_runs.cancel,
    ("runs", "again"): ordered_runs.failed_of_run,
    ("runs", "take-up"): ordered_runs.take_up,
    ("batches", "again"): ordered_runs.failed_of_batch,
}
"""Handlers of forms that make more than one call, by the form's URL parts."""


def carry_out(visit: Visit) -> Response:
    """Handles a form of the web console (cancel, restart, ...), and shows the resource again.

    Raises:
        ResourceNotFoundException: The console has no such action, or the catalog no such resource.
        AccessDeniedException: The visitor's key is not good for it.
        ServiceError: The action is not possible in the present state of the resource.
    """
    folder, resource_id, act = (visit.request.path_params[name] for name in ("folder", "id", "act"))
    if (other := _OTHERS.get((folder, act))) is not None:
        return other(visit)
    found = _ACTS.get((folder, act))
    if found is None:
        raise ResourceNotFoundException(f"there is nothing called {act!r} to do here")
    operation, member = found
    kind = next(kind for kind, each in FOLDERS.items() if each == folder)
    visit.call(operation, {member: visit.service.arn(kind, resource_id)})
    return RedirectResponse(address(kind, resource_id), 303)


LOGGER = logging.getLogger("robomaker.endpoint")

Page = Callable[[Visit], Response]

_ADDED = (
    (
        b"content-security-policy",
        b"default-src 'none'; style-src 'self'; script-src 'self'; img-src 'self' data:; media-src 'self'; "
        b"connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    # Not `no-referrer`, with which browsers hide the origin of our own forms.
    (b"referrer-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)
"""HTTP headers added to every response: browsers run and load only the console's own files."""

_PAGES: dict[str, Page] = {
    "": overview.show,
    "/live": overview.follow,
    "/search": overview.find,
    "/batches": batches.show_all,
    "/batches/{id}": batches.show,
    "/batches/{id}/live": batches.follow,
    "/jobs": jobs.show_all,
    "/jobs/{id}": jobs.show,
    "/jobs/{id}/live": jobs.follow,
    "/jobs/{id}/timeline": job_timelines.send_timeline,
    "/jobs/{id}/files/{name:path}": jobs.send,
    "/worlds/new": worlds_form.show,
    "/runs": ordered_runs.show_all,
    "/runs/new": run_starts.show,
    "/runs/{id}": ordered_runs.show,
    "/runs/{id}/live": ordered_runs.follow,
    "/runs/{id}/report": runs.send_report,
}

_LOGIN, _LOGOUT, _ASSETS = "/login", "/logout", "/assets/{version}/{name}"
_SAMPLES = {"int": "1", "float": "1.5", "uuid": str(uuid.UUID(int=1))}
"""Sample values of URL parameters, by their types in paths; others are texts."""


def add_page(module: str, path: str, page: Page) -> None:
    """Adds a user's own page to the web console.

    Args:
        module: The module's name.
        path: The page's path below `/console`.
        page: The page.

    Raises:
        ConfigurationError: The path does not begin with `/`, or another page of the console has it.
    """
    if not path.startswith("/"):
        raise ConfigurationError(f"{module} has a page {path!r}; its path has to begin with /")
    pattern, sample = _pattern(path), _sample(path)
    hidden = next((each for each in _PAGES if _pattern(each).match(sample)), None)
    hidden = hidden or next((each for each in (_LOGIN, _LOGOUT, _ASSETS) if pattern.match(_sample(each))), None)
    if hidden is not None or sample.startswith("/assets/"):
        taken = hidden or "/assets/"
        raise ConfigurationError(f"{module} has a page {path!r}, and {taken!r} is there already; give it another path")
    _PAGES[path] = page


def _pattern(path: str) -> re.Pattern[str]:
    return compile_path(path)[0]


def _sample(path: str) -> str:
    """Returns a path that matches a URL pattern of a console page, with an example for each of its parameters."""
    return re.sub(r"{\w+:?(\w*)}", lambda found: _SAMPLES.get(found[1], "x"), path)


for _module in (*modules_of(pages.__name__, "pages"), *parts_of_wings("deployments", "console.pages")):
    if not hasattr(_module, "PAGES"):
        raise ConfigurationError(f"{_module.__name__} has no PAGES, which are functions by the paths of their pages")
    for _path, _page in _module.PAGES.items():
        add_page(_module.__name__, _path, _page)
    FOLDERS |= getattr(_module, "FOLDERS", {})
    MENU += [_module.MENU] if hasattr(_module, "MENU") else []
MENU.sort()

_FORMS: Mapping[str, Page] = {
    "/runs/new": run_starts.take,
    "/runs/new/check": run_starts.check,
    "/worlds/new": worlds_form.take,
    "/worlds/new/preview": worlds_form.preview,
}


class Console:
    """Web console: serves pages below `/console`, and passes all other requests to the API server.

    Args:
        endpoint: The application of all other paths; it makes the calls of operations, and counts requests.
        service: The service, with its catalog and object store.
        access_keys: Access keys that may log in, by id; `None`: no login, and no foreign web page is admitted.
        worker_status: Returns the job worker's status to show.
        spec_runs: Runs of specifications that visitors order; `None`: they can order none.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        service: Service,
        *,
        access_keys: Mapping[str, AccessKey] | None = None,
        worker_status: Callable[[], Mapping[str, object]] = dict,
        spec_runs: SpecRuns | None = None,
    ) -> None:
        self.checks_signatures = access_keys is not None
        """Whether API requests of clients have to be signed."""

        self._endpoint = endpoint
        self._context = Context(
            service=service,
            calls=endpoint.calls,
            sessions=None if access_keys is None else Sessions(access_keys, time.monotonic),
            worker_status=worker_status,
            streams=Streams(),
            briefs=BatchBriefs(service.catalog),
            job_lines=JobLines(service.catalog),
            posters=Posters(partial(published, service=service)),
            failures=Failures(service.settings),
            form_token=secrets.token_urlsafe(32),
            spec_runs=spec_runs,
        )
        routes = [Route(f"{HOME}{path}", self._served(page)) for path, page in _PAGES.items()]
        routes += [
            Route(f"{HOME}{_LOGIN}", login.show_form(self._context), methods=["GET"]),
            Route(f"{HOME}{_LOGIN}", login.log_in(self._context), methods=["POST"]),
            Route(f"{HOME}{_LOGOUT}", self._act(login.log_out), methods=["POST"]),
            *(Route(f"{HOME}{path}", self._act(act), methods=["POST"]) for path, act in _FORMS.items()),
            Route(f"{HOME}/{{folder}}/{{id}}/{{act}}", self._act(carry_out), methods=["POST"]),
            Route(f"{HOME}{_ASSETS}", _send_asset),
        ]
        self._pages = Starlette(routes=routes, exception_handlers={HTTPException: _told})

    def end_streams(self) -> None:
        """Ends all streams to browsers, so that the server can stop."""
        self._context.streams.end()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one HTTP request of the web console (ASGI); hands all other requests on to the service's API.

        Requests that come from another site or to a foreign host name, or that may not be answered, get an error
        response instead of a page. Each request of the console is counted and logged.
        """
        path = scope.get("path", "")
        if scope["type"] != "http" or not (path == HOME or path.startswith(f"{HOME}/")):
            await self._endpoint(scope, receive, send)
            return
        is_own_host = _is_any_host if self.checks_signatures else is_local_host
        refused = refusal("http", scope["method"], scope["headers"], is_own_host, ("http", "https"))
        answer = self._pages if refused is None else PlainTextResponse(f"{refused.reason}\n", refused.status)
        if refused is None and (why := await run_in_threadpool(self._why_not, scope)) is not None:
            answer = PlainTextResponse(f"{why}\n", HTTPStatus.FORBIDDEN)
        with self._noted(ServiceRequest(scope, receive)) as seen:
            await answer(scope, receive, _guarded(send, seen))

    def _why_not(self, scope: Scope) -> str | None:
        """Returns why a request gets no page; `None` if it does.

        Programs of a simulation job, which are not trusted, get none.
        """
        if (callers := self._endpoint.job_callers) is None:
            return None
        try:
            job = callers.job_of(scope)
        except AccessDeniedException as error:
            return str(error)
        return None if job is None else "a simulation job sent this request, and the console is not for jobs"

    @contextmanager
    def _noted(self, request: ServiceRequest) -> Iterator[list[int]]:
        """Counts and logs a console request after the `with` block, with the status that the block adds to the list.

        A request whose block adds no status is not counted.
        """
        began = time.perf_counter()
        # Streams last as long as somebody looks, and say nothing about how quick pages are.
        request.operation = "console-stream" if request.url.path.endswith("/live") else "console"
        seen: list[int] = []
        try:
            yield seen
        finally:
            if seen:
                self._endpoint.note(request, seen[0], time.perf_counter() - began)

    def _served(self, page: Page) -> Callable[[Request], Response]:
        def serve(request: Request) -> Response:
            visit = login.visit_of(request, self._context)
            return login.ask(request) if visit is None else answered(visit, page)

        return serve

    def _act(self, act: Callable[[Visit], Response]) -> Callable[[Request], object]:
        async def serve(request: Request) -> Response:
            visit = await run_in_threadpool(login.visit_of, request, self._context)
            if visit is None:
                return login.ask(request)
            try:
                form = await read_fields(request)
            except ProtocolError as error:
                return _problem(visit, error)
            if not secrets.compare_digest(form.get("form_token", "").encode(), visit.form_token.encode()):
                return visit.page(
                    "problem.html.j2",
                    status=403,
                    title="The form is too old",
                    text="Go back, reload the page, try again.",
                )
            return await run_in_threadpool(answered, replace(visit, form=form), act)

        return serve


def answered(visit: Visit, page: Page) -> Response:
    """Returns a console page's response, or an error page if the page raises any error."""
    try:
        return page(visit)
    except Exception as error:
        return _problem(visit, error)


def _problem(visit: Visit, error: Exception) -> Response:
    status, title = _status_of(error)
    path = ascii(visit.request.url.path)[:500]
    if status == 500:
        LOGGER.error("the console cannot show %s", path, exc_info=error)
    elif status > 500:
        LOGGER.error("the console cannot show %s: %s", path, error)
    is_own = status >= 500 and not isinstance(error, ThrottlingException)
    text = "The server's log says why." if is_own else visit.context.failures.told(error)
    return visit.page("problem.html.j2", status=status, title=title, text=text)


def _status_of(error: Exception) -> tuple[int, str]:
    if isinstance(error, ResourceNotFoundException | ObjectNotFoundError):
        return 404, "Not found"
    if isinstance(error, ThrottlingException):
        return 503, "Too much at once"
    if isinstance(error, ServiceError | ProtocolError) and error.status < 500:
        return error.status, "Not done"
    if isinstance(error, StorageUnavailableError | ServiceError):
        return 503, "Something does not answer"
    return (502, "It cannot be read") if isinstance(error, RobomakerError) else (500, "Something broke")


def _told(request: Request, error: Exception) -> Response:
    """Returns the error response where there is no page, or none with this HTTP method."""
    assert isinstance(error, HTTPException)
    page = render("plain_problem.html.j2", title=HTTPStatus(error.status_code).phrase, path=request.url.path)
    return Response(page, error.status_code, headers=error.headers, media_type="text/html")


def _send_asset(request: Request) -> Response:
    name = request.path_params["name"]
    try:
        content = asset(name)
    except KeyError:
        raise HTTPException(404) from None
    media_type = "text/css" if name.endswith(".css") else "text/javascript"
    return Response(content, media_type=media_type, headers={"cache-control": "public, max-age=31536000, immutable"})


def _is_any_host(host: str) -> bool:
    """Whether a `Host` header is accepted if there are access keys.

    Any name is accepted, as a page of another site has no session.
    """
    return bool(host)


def _guarded(send: Send, seen: list[int]) -> Send:
    async def add(message: Message) -> None:
        if message["type"] == "http.response.start":
            seen.append(message["status"])
            own = {name for name, _ in message["headers"]}
            message = {**message, "headers": [*message["headers"], *(each for each in _ADDED if each[0] not in own)]}
        await send(message)

    return add
