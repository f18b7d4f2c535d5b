"""Registry of API operations: checks a request, calls its handler, returns the response, pages of lists; no Prefect.

```
@operation("DescribeWorld")                      handler(request, service) -> response
        │
        ├── call("DescribeWorld", {...}, service)       a function call: milliseconds, no flow run
        └── flows.operations.DescribeWorld(world="arn:…")   a Prefect flow named DescribeWorld

@operation("CreateWorldGenerationJob", perform=…)
        ├── call(…)                    the submit half: checks, stores the job as Pending, answers
        ├── PerformWorldGenerationJob  a flow: carries a stored job, named by ARN, to its end
        └── CreateWorldGenerationJob   a flow: both halves, one after the other
```
"""

import importlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Protocol

from ...schemas.operations.registry import MODULES, OPERATIONS, parse_request
from ...schemas.wire.base import STORED, Shape
from ...schemas.wire.common import filter_values
from ...schemas.wire.errors import InvalidParameterException, ServiceError
from ...schemas.wire.operation_shape import OperationShape, deprecated_uses
from ...schemas.wire.request_problems import nearest
from ..catalog import Page
from ..execution.leases.catalog_outages import CatalogWait
from ..service.service import Service

Answer = Shape | Mapping[str, Any]
"""Response of an operation, or its members."""

Handler = Callable[[Any, Service], Answer]

JobRunner = Callable[[str, Service], None]
"""Function that runs the stored job of an ARN to its end; a job worker calls it."""


@dataclass(frozen=True)
class Operation:
    """An API operation of the service with its handler, and for jobs the function that runs them."""

    shape: OperationShape
    handler: Handler
    run_job: JobRunner | None = None
    """Function of a job operation that runs the stored job of an ARN to its end; `None` for other operations."""

    @property
    def name(self) -> str:
        """The service's name of the operation, such as `CreateSimulationJob`."""
        return self.shape.name

    @property
    def resource(self) -> str:
        """Resource that the operation belongs to, as its modules are named: `simulation_jobs`."""
        return self.shape.request.__module__.rpartition(".")[2]

    @property
    def perform_name(self) -> str:
        """Name of the Prefect flow that runs a stored job of this operation."""
        return "Perform" + self.shape.final_name.removeprefix("Describe")

    def answer(self, data: Mapping[str, Any], service: Service) -> dict[str, Any]:
        """Checks a request, carries out the operation (for jobs: only submits the job), and returns the response.

        Raises:
            ServiceError: The request is refused; nothing was stored.
        """
        return self.handle(self.checked(data, service), service)

    def ordered(
        self, data: Mapping[str, Any], through: Callable[[str, Mapping[str, Any]], Service], service: Service
    ) -> dict[str, Any]:
        """Submits a job, as `answer` does, which the calling process will run itself.

        Args:
            data: The request's members.
            through: Returns the service that stores the job with its lease: `OwnOrder.through`.
            service: Checks the request.

        Raises:
            ServiceError: The request is refused; nothing was stored.
        """
        request = self.checked(data, service)
        return self.handle(request, through(self.name, request.to_wire()))

    def checked(self, data: Mapping[str, Any], service: Service) -> Shape:
        """Parses and checks a request by itself, without the catalog, and returns it.

        Raises:
            ServiceError: The request is refused.
        """
        with self._own_errors():
            request = parse_request(self.name, data)
            if service.settings.refuse_deprecated and (uses := deprecated_uses(self.shape, request.to_wire())):
                raise InvalidParameterException(f"no longer supported (ROBOMAKER_REFUSE_DEPRECATED): {'; '.join(uses)}")
        return request

    def handle(self, request: Shape, service: Service) -> dict[str, Any]:
        """Carries out a checked request, and returns the response.

        Raises:
            ServiceError: The request is refused; nothing was stored.
        """
        with self._own_errors():
            answer = self.handler(request, service)
            if not isinstance(answer, Shape):
                answer = self.shape.response.model_validate(answer, context=STORED)
            return answer.to_wire()

    @contextmanager
    def _own_errors(self) -> Iterator[None]:
        """Converts errors inside the `with` block to those that clients of the operation know.

        Errors of the service itself, and those that the operation declares, pass; others become
        `InvalidParameterException`.
        """
        try:
            yield
        except ServiceError as error:
            if error.status >= 500 or isinstance(error, self.shape.errors):
                raise
            raise InvalidParameterException(str(error)) from error

    def perform(self, arn: str, service: Service) -> dict[str, Any]:
        """Runs a stored job to its end, and returns its final description.

        If called again for the same job, by any job worker, it continues from the job's state. An interruption (Ctrl-C,
        the end or cancellation of the flow run) cancels the job, and is raised again once the job has ended. Raises
        `InvalidParameterException` if the operation has no job to run.
        """
        if self.run_job is None:
            raise InvalidParameterException(f"{self.name} is no job operation: it has nothing to perform")
        try:
            self.run_job(arn, service)
        except Exception:
            raise
        except BaseException:  # Ctrl-C, or a worker's termination signal: nothing is left half done
            service.catalog.request_cancel(arn)
            self.run_job(arn, service)
            raise
        wait = CatalogWait(arn, lambda: service.catalog.standing(arn), lambda: False, service.timing.after_outage_s)
        return wait.outlasting(lambda: self.described(arn, service))

    def described(self, arn: str, service: Service) -> dict[str, Any]:
        """Returns the current description of a job that this operation created.

        Raises:
            ResourceNotFoundException: The catalog has no such job.
        """
        describing = registry()[self.shape.final_name]
        (member,) = describing.shape.request.model_fields
        return describing.answer({member: arn}, service)


_registry: dict[str, Operation] = {}


def operation(name: str, *, perform: JobRunner | None = None) -> Callable[[Handler], Handler]:
    """Returns a decorator that registers a function as the handler of a service operation.

    The decorator raises `ValueError` if a job operation has nothing to perform, or another has.

    Args:
        name: The operation's name, a key of `OPERATIONS`.
        perform: For job operations, function that runs the job of an ARN to its end.
    """

    def register(handler: Handler) -> Handler:
        shape = OPERATIONS[name]
        if shape.is_job != (perform is not None):
            raise ValueError(f"{name}: job operations, and only they, have something to perform")
        _registry[name] = Operation(shape, handler, perform)
        return handler

    return register


@cache
def registry() -> Mapping[str, Operation]:
    """Returns all API operations with their handlers, by name; the first call imports the modules that have them."""
    for module in MODULES:
        importlib.import_module(module.replace(".schemas.", ".tasks.", 1))
    return dict(sorted(_registry.items()))


def call(name: str, data: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Calls an API operation in this process; for jobs this only submits the job.

    Args:
        name: The operation's name.
        data: The request's members, as an SDK would send them.
        service: The service, with its catalog and object store.

    Returns:
        The members of the response that are present.

    Raises:
        ServiceError: The request is refused.
    """
    operations = registry()
    if name not in operations:
        parse_request(name, data)  # raises, naming the nearest operations
        raise InvalidParameterException(f"{name} is for steps of specifications; it cannot be called")
    return operations[name].answer(data, service)


def flow_names() -> set[str]:
    """Returns the names that this package's flows have in Prefect: of operations, of their jobs, and `RunPipeline`."""
    operations = registry().values()
    performing = {entry.perform_name for entry in operations if entry.run_job}
    return {"RunPipeline", *performing, *(entry.name for entry in operations)}


class ListRequest(Protocol):
    """Interface of a request that asks for a page of a list."""

    @property
    def nextToken(self) -> str | None:  # noqa: N802 - the service's name
        """Token of the previous page's response, to continue after it."""
        ...

    @property
    def maxResults(self) -> int | None:  # noqa: N802 - the service's name
        """Maximum number of entries in a page."""
        ...


def page_of(
    request: ListRequest,
    kinds: str | Sequence[str],
    service: Service,
    *filters: str,
    most: int = 100,
    members: Sequence[str] | None = None,
    without: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> Page:
    """Reads the page of resources that a list request asks for, newest first.

    Args:
        request: Says how many entries, after which, and its filters; page tokens are good for its operation only.
        kinds: The kinds of resources that are listed.
        service: The service, with its catalog and object store.
        filters: Names of the operation's filters: `name`, `status` or a label of the resource.
        most: Entries per page, unless the request asks for fewer.
        members: Members of large documents to read; `None`: all.
        without: Names that are left out, by kind.

    Raises:
        InvalidParameterException: A filter is not known, or the token is not of this list.
    """
    wanted: dict[str, Sequence[str]] = {}
    for name, values in filter_values(getattr(request, "filters", None)).items():
        if name not in filters:
            known = f"known are {', '.join(sorted(filters))}" if filters else "this list has none"
            raise InvalidParameterException(f"filters: {name!r} is not known{nearest(name, filters)}; {known}")
        wanted[name] = values
    return service.catalog.list(
        kinds,
        filters=wanted,
        limit=min(request.maxResults or most, most),
        after=request.nextToken,
        scope=type(request).__name__.removesuffix("Request"),
        members=members,
        without=without,
    )
