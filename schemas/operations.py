"""The service's operations as data: what each takes, gives and refuses, and how it is reached.

Extensions to the service's inputs, all of them:

| shape | member | what it adds |
| --- | --- | --- |
| `CreateWorldGenerationJobRequest` | `seed` | worlds that can be generated again; also the tag `robomaker:seed` |
| both orders of simulation jobs | `seed` | runs that can be repeated; also the tag `robomaker:seed` |
| both orders of simulation jobs | `video` | `none` or `always`; also the tag `robomaker:video` |
| both `...ApplicationConfig` | `application` | a bare name is as good as an ARN |
| `CreateWorldTemplateRequest` | `templateBody` | a mapping is as good as JSON text |
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, get_args

from pydantic import ValidationError

from . import errors
from .base import Shape
from .common import MAX_SEED
from .request_problems import RequestProblem, nearest, problems_of
from .robot_applications import CreateRobotApplicationRequest, CreateRobotApplicationResponse
from .simulation_applications import CreateSimulationApplicationRequest, CreateSimulationApplicationResponse
from .simulation_job_batches import (
    DescribeSimulationJobBatchRequest,
    DescribeSimulationJobBatchResponse,
    StartSimulationJobBatchRequest,
    StartSimulationJobBatchResponse,
)
from .simulation_jobs import (
    BatchDescribeSimulationJobRequest,
    BatchDescribeSimulationJobResponse,
    CreateSimulationJobRequest,
    CreateSimulationJobResponse,
    DescribeSimulationJobRequest,
    DescribeSimulationJobResponse,
    SimulationJobOrder,
)
from .simulation_run import VideoPolicy
from .world_export_jobs import (
    CreateWorldExportJobRequest,
    CreateWorldExportJobResponse,
    DescribeWorldExportJobRequest,
    DescribeWorldExportJobResponse,
)
from .world_generation_jobs import (
    CreateWorldGenerationJobRequest,
    CreateWorldGenerationJobResponse,
    DescribeWorldGenerationJobRequest,
    DescribeWorldGenerationJobResponse,
)
from .world_templates import (
    CreateWorldTemplateRequest,
    CreateWorldTemplateResponse,
    DescribeWorldTemplateRequest,
    DescribeWorldTemplateResponse,
    GetWorldTemplateBodyRequest,
    GetWorldTemplateBodyResponse,
)
from .worlds import DescribeWorldRequest, DescribeWorldResponse, ListWorldsRequest, ListWorldsResponse

EXTENSIONS: Mapping[str, frozenset[str]] = {
    "CreateWorldGenerationJobRequest": frozenset({"seed"}),
    "CreateSimulationJobRequest": frozenset({"seed", "video"}),
    "SimulationJobRequest": frozenset({"seed", "video"}),
    "RobotApplicationConfig": frozenset({"application"}),
    "SimulationApplicationConfig": frozenset({"application"}),
    "CreateWorldTemplateRequest": frozenset({"templateBody"}),
}
"""Members, by shape, that are not in the service's interface or take more than it does."""

SEED_TAG = "robomaker:seed"
VIDEO_TAG = "robomaker:video"

_Value = TypeVar("_Value")
ErrorClass = type[errors.ServiceError]


@dataclass(frozen=True)
class OperationShape:
    """One operation."""

    name: str
    """The service's name of it."""

    request: type[Shape]
    """What it takes."""

    response: type[Shape]
    """What it gives."""

    errors: tuple[ErrorClass, ...]
    """What it may raise."""

    description: str
    """What it does, in one line."""

    is_job: bool = False
    """Whether it starts something that goes on after the answer."""

    method: str = "POST"
    """HTTP method."""

    @property
    def path(self) -> str:
        """HTTP path."""
        return "/" + self.name[0].lower() + self.name[1:]


_INVALID = errors.InvalidParameterException
_EXISTS = errors.ResourceAlreadyExistsException
_NOT_FOUND = errors.ResourceNotFoundException
_MISMATCH = errors.IdempotentParameterMismatchException
_LIMIT = errors.LimitExceededException
_THROTTLED = errors.ThrottlingException
_INTERNAL = errors.InternalServerException
_UNAVAILABLE = errors.ServiceUnavailableException

_LIST = (_INVALID, _THROTTLED, _INTERNAL)
_READ = (_INVALID, _NOT_FOUND, _THROTTLED, _INTERNAL)
_CREATE_APPLICATION = (_INVALID, _EXISTS, _LIMIT, _THROTTLED, _INTERNAL, _MISMATCH)
_EXPORT = (_NOT_FOUND, _INVALID, _INTERNAL, _THROTTLED, _MISMATCH, _UNAVAILABLE)

_ALL = (
    OperationShape(
        "CreateWorldTemplate",
        CreateWorldTemplateRequest,
        CreateWorldTemplateResponse,
        (_INVALID, _EXISTS, _NOT_FOUND, _LIMIT, _THROTTLED, _INTERNAL),
        "Keeps a description that worlds can be generated from.",
    ),
    OperationShape(
        "DescribeWorldTemplate",
        DescribeWorldTemplateRequest,
        DescribeWorldTemplateResponse,
        _READ,
        "Says what is known of a world template.",
    ),
    OperationShape(
        "GetWorldTemplateBody",
        GetWorldTemplateBodyRequest,
        GetWorldTemplateBodyResponse,
        _READ,
        "Gives a world template's body, as it is or as a generation job used it.",
    ),
    OperationShape(
        "CreateWorldGenerationJob",
        CreateWorldGenerationJobRequest,
        CreateWorldGenerationJobResponse,
        (*_EXPORT, _LIMIT),
        "Generates worlds from a template.",
        is_job=True,
    ),
    OperationShape(
        "DescribeWorldGenerationJob",
        DescribeWorldGenerationJobRequest,
        DescribeWorldGenerationJobResponse,
        _READ,
        "Says how far a world generation job is and which worlds it made.",
    ),
    OperationShape("DescribeWorld", DescribeWorldRequest, DescribeWorldResponse, _READ, "Says what a world holds."),
    OperationShape("ListWorlds", ListWorldsRequest, ListWorldsResponse, _LIST, "Lists worlds, newest first."),
    OperationShape(
        "CreateWorldExportJob",
        CreateWorldExportJobRequest,
        CreateWorldExportJobResponse,
        _EXPORT,
        "Packs worlds into an archive in the object store.",
        is_job=True,
    ),
    OperationShape(
        "DescribeWorldExportJob",
        DescribeWorldExportJobRequest,
        DescribeWorldExportJobResponse,
        _READ,
        "Says how far a world export job is.",
    ),
    OperationShape(
        "CreateRobotApplication",
        CreateRobotApplicationRequest,
        CreateRobotApplicationResponse,
        _CREATE_APPLICATION,
        "Makes a robot application known under a name.",
    ),
    OperationShape(
        "CreateSimulationApplication",
        CreateSimulationApplicationRequest,
        CreateSimulationApplicationResponse,
        _CREATE_APPLICATION,
        "Makes a simulation application known under a name.",
    ),
    OperationShape(
        "CreateSimulationJob",
        CreateSimulationJobRequest,
        CreateSimulationJobResponse,
        (*_EXPORT, _LIMIT),
        "Runs one simulation.",
        is_job=True,
    ),
    OperationShape(
        "DescribeSimulationJob",
        DescribeSimulationJobRequest,
        DescribeSimulationJobResponse,
        _READ,
        "Says how far a simulation job is, and how it ended.",
    ),
    OperationShape(
        "BatchDescribeSimulationJob",
        BatchDescribeSimulationJobRequest,
        BatchDescribeSimulationJobResponse,
        _READ,
        "Says the same of up to 100 simulation jobs.",
    ),
    OperationShape(
        "StartSimulationJobBatch",
        StartSimulationJobBatchRequest,
        StartSimulationJobBatchResponse,
        (_INVALID, _LIMIT, _THROTTLED, _MISMATCH, _INTERNAL),
        "Runs many simulations, so many at a time.",
        is_job=True,
    ),
    OperationShape(
        "DescribeSimulationJobBatch",
        DescribeSimulationJobBatchRequest,
        DescribeSimulationJobBatchResponse,
        (_NOT_FOUND, _INVALID, _INTERNAL),
        "Says how far a batch is and what became of its requests.",
    ),
)

OPERATIONS: Mapping[str, OperationShape] = {operation.name: operation for operation in _ALL}
"""Every operation by name."""


def operation_shape(name: str) -> OperationShape:
    """Looks an operation up.

    Raises:
      InvalidParameterException: there is none of that name; the message has the nearest.
    """
    if (operation := OPERATIONS.get(name)) is None:
        hint = nearest(name, OPERATIONS) or f"; there are {', '.join(sorted(OPERATIONS))}"
        raise errors.InvalidParameterException(f"there is no operation {name!r}{hint}")
    return operation


def check_request(operation_name: str, data: Mapping[str, Any]) -> list[RequestProblem]:
    """Lists everything wrong with a request; empty when it can be parsed.

    Raises:
      InvalidParameterException: there is no operation of that name.
    """
    model = operation_shape(operation_name).request
    try:
        model.model_validate(dict(data))
    except ValidationError as error:
        return problems_of(error, model)
    return []


def parse_request(operation_name: str, data: Mapping[str, Any]) -> Shape:
    """Makes an operation's request from plain values.

    Args:
      operation_name: the service's name of the operation.
      data: members by name, as JSON or YAML give them.

    Raises:
      InvalidParameterException: one line per problem, each with the member's path, its value and
        what would be right; or there is no operation of that name.
    """
    model = operation_shape(operation_name).request
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        lines = [f"{operation_name}: {problem}" for problem in problems_of(error, model)]
        raise errors.InvalidParameterException("\n".join(lines)) from error


def seed_of(request: CreateWorldGenerationJobRequest | SimulationJobOrder) -> int | None:
    """The seed a request asks for, by its member or by its tag.

    Raises:
      InvalidParameterException: the tag is no whole number, or says something else than the member.
    """
    tag = (request.tags or {}).get(SEED_TAG)
    if tag is None:
        return request.seed
    if not re.fullmatch("[0-9]+", tag) or int(tag) > MAX_SEED:
        raise _INVALID(f"tags.{SEED_TAG} is {tag!r}; it has to be a whole number from 0 to {MAX_SEED}")
    return _agreed("seed", SEED_TAG, request.seed, int(tag))


def video_of(request: SimulationJobOrder) -> VideoPolicy | None:
    """The video policy a request asks for, by its member or by its tag.

    Raises:
      InvalidParameterException: the tag is no policy, or says something else than the member.
    """
    tag = (request.tags or {}).get(VIDEO_TAG)
    if tag is None:
        return request.video
    for policy in get_args(VideoPolicy):
        if tag == policy:
            return _agreed("video", VIDEO_TAG, request.video, policy)
    raise _INVALID(f"tags.{VIDEO_TAG} is {tag!r}; it has to be {' or '.join(map(repr, get_args(VideoPolicy)))}")


def _agreed(member: str, tag: str, by_member: _Value | None, by_tag: _Value) -> _Value:
    if by_member is not None and by_member != by_tag:
        raise _INVALID(f"{member} is {by_member!r}, but tags.{tag} is {by_tag!r}; leave one of them out")
    return by_tag
