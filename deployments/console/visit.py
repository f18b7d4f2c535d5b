"""A visit of the console: who asks for what, and what that visitor may see."""

import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from ...schemas.runs.axes import AXIS_TAG, tag_in_words
from ...schemas.wire.errors import InternalServerException, ResourceNotFoundException
from ...tasks.catalog import Page, Resource
from ...tasks.service.references import names_of_worlds
from ...tasks.service.service import Service
from ..endpoint.calling.access_keys import AccessKey
from ..endpoint.calling.audit_log import Call
from ..endpoint.calling.scopes import SCOPES, Calls, is_visible, needed_scope
from ..endpoint.failures import Failures
from ..spec_runs.spec_runs import SpecRuns
from .batch_caches import BatchBriefs, JobLines, Posters
from .rendering import render
from .sessions import Session, Sessions
from .streams import Look, Streams


@dataclass(frozen=True)
class Context:
    """Objects shared by all pages of the web console: service, sessions, settings."""

    service: Service
    calls: Calls
    sessions: Sessions | None
    """Login sessions; `None`: there are no access keys, and each visitor may do everything."""

    worker_status: Callable[[], Mapping[str, object]]
    streams: Streams
    briefs: BatchBriefs
    job_lines: JobLines
    posters: Posters
    failures: Failures
    """Converter of errors to messages without paths of this machine."""
    form_token: str
    """Secret token of forms where there are no sessions."""

    spec_runs: SpecRuns | None = None
    """Runs of specifications that visitors order; `None`: this server performs none."""


@dataclass(frozen=True)
class Visit:
    """A request of a logged-in visitor to the web console."""

    request: Request
    context: Context
    session: Session | None
    form: Mapping[str, str] = field(default_factory=dict)
    """Fields of the web form that the visitor submitted."""

    _worlds: dict[str, str] = field(default_factory=dict[str, str])
    """Names of worlds that tags of the page say, by ARN."""

    @property
    def service(self) -> Service:
        """RoboMaker service whose resources (jobs, worlds, ...) the web console shows to the visitor."""
        return self.context.service

    @property
    def key(self) -> AccessKey | None:
        """The visitor's access key; `None` if no login is required."""
        return self.session and self.session.key

    @property
    def address(self) -> str | None:
        """Network address of the visitor; `None` if unknown."""
        return self.request.client.host if self.request.client else None

    def tag_in_words(self, name: str, value: str) -> str:
        """Formats a tag for people; an axis whose value is a world has that world's name and its id."""
        if not name.startswith(AXIS_TAG) or ":world/" not in value:
            return tag_in_words(name, value)
        if value not in self._worlds:
            # The one world is asked for by each tag of a page; one that is deleted has its id only.
            world_id = value.rpartition(":world/")[2]
            found = names_of_worlds([value], self.service).get(value, world_id)
            self._worlds[value] = found if found == world_id else f"{found} ({world_id})"
        return tag_in_words(name, self._worlds[value])

    @property
    def form_token(self) -> str:
        """Secret token in this visitor's forms, against forged requests (CSRF)."""
        return self.session.form_token if self.session else self.context.form_token

    @property
    def sees_all(self) -> bool:
        """Whether the visitor may see all resources."""
        return self.key is None or not self.key.is_confined

    @property
    def may_order_runs(self) -> bool:
        """Whether the visitor may order runs of specifications on this server."""
        return self.context.spec_runs is not None and self.may("StartSimulationJobBatch")

    def may(self, operation: str) -> bool:
        """Whether the visitor's access key allows an API operation."""
        return self.key is None or SCOPES.index(self.key.scope) >= SCOPES.index(needed_scope(operation))

    def seen(self, resources: Iterable[Resource]) -> list[Resource]:
        """Returns those of the given resources that the visitor may see."""
        key = self.key
        if key is None or not key.is_confined:
            return list(resources)
        return [each for each in resources if is_visible(key, each, self.service.catalog)]

    def listed(self, kind: str, filters: Mapping[str, Sequence[str]], limit: int, members: Sequence[str]) -> Page:
        """Returns the requested page of a list of resources, newest first, without checking visibility."""
        after = self.parameter("after") or None
        return self.service.catalog.list(
            kind, filters=filters, limit=limit, after=after, scope="console", members=members
        )

    def find(self, kind: str, resource_id: str, members: Sequence[str] | None = None) -> Resource:
        """Returns a resource that the visitor may see.

        Args:
            kind: Kind of the resource.
            resource_id: Id of the resource.
            members: Members of its document to read; `None`: all.

        Raises:
            ResourceNotFoundException: The resource does not exist, or the visitor may not see it.
        """
        arn = self.service.arn(kind, resource_id)
        found = self.seen(self.service.catalog.get_many([arn], members).values())
        if not found or found[0].kind != kind:
            raise ResourceNotFoundException(f"there is no resource {arn}")
        return found[0]

    def sees(self, arn: str | None) -> bool:
        """Whether a resource exists that the visitor may see, so that a page may link to it; false for no ARN.

        A visitor who sees everything may get a link to a resource that is deleted.
        """
        if not arn or self.sees_all:
            return bool(arn)
        return bool(self.seen(self.service.catalog.get_many([arn], ()).values()))

    def call(self, operation: str, members: Mapping[str, Any]) -> dict[str, Any]:
        """Calls an API operation with the visitor's rights.

        Raises:
            AccessDeniedException: The visitor's key is not good for it.
            ServiceError: The request is refused.
        """
        call = Call(str(uuid.uuid4()), self.address, self.key)
        return self.context.calls.make(operation, members, call)

    @contextmanager
    def noted(self, name: str, *resources: str, if_refused: bool = False) -> Iterator[Call]:
        """Writes an action of the visitor that is no API call to the audit log.

        Args:
            name: Name of the action, for the audit log.
            resources: ARNs or names of the resources.
            if_refused: Whether only a refusal is written, because a call that follows writes the rest.

        Yields:
            The entry of the audit log, to which the created resources are added.
        """
        call = Call(str(uuid.uuid4()), self.address, self.key, name, resources)
        try:
            yield call
        except Exception as error:
            call.outcome = getattr(error, "code", InternalServerException.__name__)
            raise
        finally:
            if not if_refused or call.outcome != "ok":
                self.context.calls.write(call)

    def parameter(self, name: str) -> str:
        """Returns a query parameter of the URL; empty if missing."""
        return self.request.query_params.get(name, "")

    def follow(self, look: Look, every_s: float) -> Response:
        """Streams updates to the browser each `every_s` seconds, until `look` ends it or the session expires."""

        def allowed() -> Iterator[tuple[str, Any]]:
            sessions = self.context.sessions
            if sessions is None or sessions.find(self.request.cookies.get(cookie_name(self.request))) is self.session:
                yield from look()
            else:
                yield "end", None

        return self.context.streams.follow(allowed, every_s)

    def page(self, template: str, /, *, status: int = 200, **values: Any) -> Response:
        """Renders a page of the console as HTTP response."""
        return HTMLResponse(render(template, visit=self, **values), status)


def cookie_name(request: Request) -> str:
    """Returns the name of the session cookie, which contains the server's port."""
    _, port = request.scope.get("server") or ("", None)
    return f"robomaker_console_{port or 'default'}"
