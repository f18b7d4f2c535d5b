"""One registry of operations: from typed handlers to direct calls and Prefect flows.

```
@operation("DescribeWorld")                      handler(request, service) -> response
        │
        ├── call("DescribeWorld", {...}, service)       a function call: milliseconds, no flow run
        └── flows.worlds.DescribeWorld(world="arn:…")   a Prefect flow named DescribeWorld

@operation("CreateWorldGenerationJob", perform=…)
        ├── call(…)                    the submit half: checks, stores the job as Pending, answers
        ├── PerformWorldGenerationJob  a flow: carries a stored job, named by ARN, to its end
        └── CreateWorldGenerationJob   a flow: both halves, one after the other
```

Importing Prefect costs seconds, so flows are made when they are first asked for: each module of
this package ends with `__getattr__ = flows_of(__name__)`.
"""

import importlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from ..schemas.operations.deprecations import deprecated_uses
from ..schemas.operations.registry import OPERATIONS, OperationShape, parse_request
from ..schemas.wire.base import Shape
from ..schemas.wire.errors import InvalidParameterException, ServiceError
from ..tasks.service.service import Service

if TYPE_CHECKING:
    from prefect import Flow

Handler = Callable[[Any, Service], Shape]
Performer = Callable[[str, Service], None]

_MODULES = (
    "deployment_jobs",
    "fleets",
    "robot_applications",
    "robots",
    "simulation_applications",
    "simulation_job_batches",
    "simulation_jobs",
    "tags",
    "world_export_jobs",
    "world_generation_jobs",
    "world_templates",
    "worlds",
)


@dataclass(frozen=True)
class Operation:
    """One operation of the service."""

    shape: OperationShape
    handler: Handler
    module: str
    performer: Performer | None = None
    describe: str | None = None
    """The operation that tells how a job stands; its response is what the flow returns."""

    @property
    def name(self) -> str:
        """The service's name for it."""
        return self.shape.name

    @property
    def perform_name(self) -> str:
        """Name of the flow that performs a stored job."""
        return "Perform" + self.name.removeprefix("Create").removeprefix("Start")

    def answer(self, data: Mapping[str, Any], service: Service) -> dict[str, Any]:
        """Checks the request, does the operation (for jobs: the submit half), and answers.

        Raises:
          ServiceError: the request is refused; nothing was stored.
        """
        try:
            request = parse_request(self.name, data)
            if service.settings.refuse_deprecated and (uses := deprecated_uses(self.shape, request.to_wire())):
                raise InvalidParameterException(f"no longer supported (ROBOMAKER_REFUSE_DEPRECATED): {'; '.join(uses)}")
            return self.handler(request, service).to_wire()
        except ServiceError as error:
            if error.status >= 500 or isinstance(error, self.shape.errors):
                raise
            # Clients know an operation's own errors only; this one says what is wrong in their terms.
            raise InvalidParameterException(str(error)) from error

    def perform(self, arn: str, service: Service) -> dict[str, Any]:
        """Carries a stored job to its end and returns its final description.

        Called again for the same job, by whomever, it goes on where the job stands. An interruption
        (Ctrl-C, the end or cancellation of the flow run) cancels the job, and goes on once it has ended.
        """
        if self.performer is None:
            raise InvalidParameterException(f"{self.name} is no job operation: it has nothing to perform")
        try:
            self.performer(arn, service)
        except Exception:
            raise
        except BaseException:  # Ctrl-C, or a worker's termination signal: nothing is left half done
            service.catalog.request_cancel(arn)
            self.performer(arn, service)
            raise
        return self.described(arn, service)

    def described(self, arn: str, service: Service) -> dict[str, Any]:
        """How a job of this operation stands.

        Raises:
          ResourceNotFoundException: there is no such job.
        """
        if self.describe is None:
            raise InvalidParameterException(f"{self.name} is no job operation: it has nothing to describe")
        member = "batch" if "batch" in self.shape_of(self.describe).request.model_fields else "job"
        return registry()[self.describe].answer({member: arn}, service)

    @staticmethod
    def shape_of(name: str) -> OperationShape:
        """The shapes of an operation, by name."""
        return OPERATIONS[name]


_registry: dict[str, Operation] = {}


def operation(
    name: str, *, perform: Performer | None = None, describe: str | None = None
) -> Callable[[Handler], Handler]:
    """Registers a handler as the service's operation `name`.

    Args:
      name: the operation's name, a key of `OPERATIONS`.
      perform: for job operations, what carries the job of an ARN to its end.
      describe: for job operations, the operation that describes the job.
    """

    def register(handler: Handler) -> Handler:
        shape = OPERATIONS[name]
        if shape.is_job != (perform is not None):
            raise ValueError(f"{name}: job operations, and only they, have something to perform")
        _registry[name] = Operation(shape, handler, handler.__module__, perform, describe)
        return handler

    return register


@cache
def registry() -> Mapping[str, Operation]:
    """All operations, by name."""
    for module in _MODULES:
        importlib.import_module(f".{module}", __package__)
    return dict(sorted(_registry.items()))


def call(name: str, data: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Calls an operation directly; for job operations this only submits the job.

    Args:
      name: the operation's name.
      data: the request's members, as an SDK would send them.
      service: where it happens.

    Returns:
      The members of the response that are present.

    Raises:
      ServiceError: the request is refused.
    """
    operations = registry()
    if name not in operations:
        parse_request(name, data)  # raises, naming the nearest operations
        raise InvalidParameterException(f"operation {name!r} is not served yet")
    return operations[name].answer(data, service)


def flows_of(module: str) -> Callable[[str], "Flow[..., Any]"]:
    """Makes the `__getattr__` through which a module offers its operations as flows."""

    def find(name: str) -> "Flow[..., Any]":
        for entry in _registry.values():
            if entry.module == module and name == entry.name:
                return operation_flow(name)
            if entry.module == module and entry.performer and name == entry.perform_name:
                return perform_flow(entry.name)
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    return find


@cache
def operation_flow(name: str) -> "Flow[..., Any]":
    """The operation as a Prefect flow whose parameters are the request's members."""
    from prefect import flow

    entry = registry()[name]

    def run(**members: Any) -> dict[str, Any]:
        service = Service.current()
        request = {member: value for member, value in members.items() if value is not None}
        answer = entry.answer(request, service)
        return _perform_shown(entry, answer["arn"], service) if entry.performer else answer

    _take_signature(run, name, entry.shape.request)
    run.__module__ = entry.module
    # The request model checks more, and says it better, than a generic validation of parameters.
    return flow(name=name, description=entry.shape.description, validate_parameters=False)(run)


@cache
def perform_flow(name: str) -> "Flow[..., Any]":
    """The perform half of a job operation as a Prefect flow of one parameter, the job's ARN."""
    from prefect import flow

    entry = registry()[name]

    def run(arn: str) -> dict[str, Any]:
        return _perform_shown(entry, arn, Service.current())

    run.__module__ = entry.module
    description = f"Carries the job of an ARN, made by {name}, to its end."
    return flow(name=entry.perform_name, description=description, flow_run_name=_job_id)(run)


def _job_id() -> str:
    """The name of a flow run that performs a job: the id at the end of the job's ARN."""
    from prefect.runtime import flow_run

    return str(flow_run.parameters["arn"]).rsplit("/", 1)[-1]


def _perform_shown(entry: Operation, arn: str, service: Service) -> dict[str, Any]:
    """Performs a job with its progress in Prefect's UI."""
    from ..tasks.execution.artifacts import shown_progress

    with shown_progress(service, f"{entry.name}: {arn}") as watched, watched.activated():
        return entry.perform(arn, watched)


def _take_signature(function: Callable[..., Any], name: str, request: type[Shape]) -> None:
    """Gives a function its name, and the request's members as keyword parameters, so that Prefect shows them."""
    parameters = [
        inspect.Parameter(
            member,
            inspect.Parameter.KEYWORD_ONLY,
            annotation=field.rebuild_annotation(),
            default=inspect.Parameter.empty if field.is_required() else None,
        )
        for member, field in request.model_fields.items()
    ]
    parameters.sort(key=lambda parameter: parameter.default is None)
    # What is wrong with a call is said of the function of that name.
    function.__name__ = function.__qualname__ = name
    function.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    function.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
