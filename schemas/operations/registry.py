"""Table of the service's operations: request, response, errors and HTTP path of each.

`differences` lists all differences to the operations that AWS published, including extensions.
"""

import re
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any, TypeVar

from pydantic import ValidationError

from ..runs.plan import VideoPolicy
from ..wings import parts_of_wings
from ..wire.base import Shape, choices
from ..wire.common import MAX_SEED
from ..wire.errors import InvalidParameterException
from ..wire.operation_shape import OperationShape
from ..wire.request_problems import RequestProblem, nearest, null_characters, problems_of
from ..worlds.step_operations import STEP_OPERATIONS
from . import (
    robot_applications,
    simulation_applications,
    simulation_job_batches,
    simulation_jobs,
    tags,
    world_export_jobs,
    world_generation_jobs,
    world_templates,
    worlds,
)
from .simulation_job_batches import MOST_PRIORITY, StartSimulationJobBatchRequest
from .simulation_jobs import SimulationJobRequestMembers
from .world_generation_jobs import CreateWorldGenerationJobRequest

_MODULES: Mapping[str, ModuleType] = {
    "World templates": world_templates,
    "World generation jobs": world_generation_jobs,
    "Worlds": worlds,
    "World export jobs": world_export_jobs,
    "Robot applications": robot_applications,
    "Simulation applications": simulation_applications,
    "Simulation jobs": simulation_jobs,
    "Simulation job batches": simulation_job_batches,
    **{title: module for part in parts_of_wings("schemas", "operations") for title, module in part.GROUPS.items()},
    "Tags": tags,
}

OPERATION_GROUPS: Mapping[str, tuple[OperationShape, ...]] = {
    title: module.OPERATIONS for title, module in _MODULES.items()
}
"""Operations by title, in the order in which users need them."""

MODULES: tuple[str, ...] = tuple(sorted(module.__name__ for module in _MODULES.values()))
"""Full names of the modules with operations, including those of extensions (wings)."""

SEED_TAG = "robomaker:seed"
VIDEO_TAG = "robomaker:video"
PRIORITY_TAG = "robomaker:priority"

_Value = TypeVar("_Value")

OPERATIONS: Mapping[str, OperationShape] = {
    shape.name: shape for title in sorted(OPERATION_GROUPS) for shape in OPERATION_GROUPS[title]
}
"""Operations by name."""

STEPS: Mapping[str, OperationShape] = dict(sorted({**OPERATIONS, **STEP_OPERATIONS}.items()))
"""Operations that steps of specifications may use: all operations, and those that only steps have."""


def operation_shape(name: str) -> OperationShape:
    """Returns the description of a service operation (request, response, HTTP path, errors) by its name.

    Raises:
        InvalidParameterException: The service has no operation of this name; the message names the most similar one.
    """
    if (operation := OPERATIONS.get(name)) is None:
        hint = nearest(name, OPERATIONS) or f"; there are {', '.join(sorted(OPERATIONS))}"
        raise InvalidParameterException(f"there is no operation {name!r}{hint}")
    return operation


def check_request(operation_name: str, data: Mapping[str, Any]) -> list[RequestProblem]:
    """Lists everything wrong with the plain data of a request; the list is empty for a valid request.

    Raises:
        InvalidParameterException: The service has no operation of this name.
    """
    model = (STEPS.get(operation_name) or operation_shape(operation_name)).request
    try:
        model.model_validate(dict(data))
    except ValidationError as error:
        return problems_of(error, model)
    return null_characters(data)


def parse_request(operation_name: str, data: Mapping[str, Any]) -> Shape:
    """Parses and validates the plain data of a request for a service operation.

    Args:
        operation_name: Name of the operation.
        data: Members by name, as in JSON or YAML.

    Raises:
        InvalidParameterException: One line per problem, each with the member's path, its value and
            what would be right; or there is no operation of that name.
    """
    model = (STEPS.get(operation_name) or operation_shape(operation_name)).request
    try:
        request = model.model_validate(dict(data))
    except ValidationError as error:
        raise _refused(operation_name, problems_of(error, model)) from error
    if problems := null_characters(data):
        raise _refused(operation_name, problems)
    return request


def _refused(operation_name: str, problems: Sequence[RequestProblem]) -> InvalidParameterException:
    return InvalidParameterException("\n".join(f"{operation_name}: {problem}" for problem in problems))


def seed_of(request: CreateWorldGenerationJobRequest | SimulationJobRequestMembers) -> int | None:
    """Returns the random seed that a request asks for, by its member or by its tag; `None` if it asks for none.

    Raises:
        InvalidParameterException: The tag is not an integer, or contradicts the member.
    """
    tag = (request.tags or {}).get(SEED_TAG)
    if tag is None:
        return request.seed
    if not re.fullmatch("[0-9]+", tag) or int(tag) > MAX_SEED:
        raise InvalidParameterException(f"tags.{SEED_TAG} is {tag!r}; it has to be a whole number from 0 to {MAX_SEED}")
    return agreed("seed", SEED_TAG, request.seed, int(tag))


def video_of(request: SimulationJobRequestMembers) -> VideoPolicy | None:
    """Returns the video policy that a simulation job request asks for, by its member or by its tag; `None` if none.

    Raises:
        InvalidParameterException: The tag is not a video policy, or contradicts the member.
    """
    tag = (request.tags or {}).get(VIDEO_TAG)
    if tag is None:
        return request.video
    for policy in choices(VideoPolicy):
        if tag == policy:
            return agreed("video", VIDEO_TAG, request.video, policy)
    *others, last = map(repr, choices(VideoPolicy))
    raise InvalidParameterException(f"tags.{VIDEO_TAG} is {tag!r}; it has to be {', '.join(others)} or {last}")


def priority_of(request: StartSimulationJobBatchRequest) -> int | None:
    """Returns the priority that a batch request asks for, by its policy or its tag; `None` if it asks for none.

    Raises:
        InvalidParameterException: The tag is not a priority, or contradicts the policy.
    """
    by_member = request.batchPolicy.priority if request.batchPolicy else None
    tag = (request.tags or {}).get(PRIORITY_TAG)
    if tag is None:
        return by_member
    if not re.fullmatch("-?[0-9]{1,3}", tag) or abs(int(tag)) > MOST_PRIORITY:
        raise InvalidParameterException(
            f"tags.{PRIORITY_TAG} is {tag!r}; it has to be a whole number from {-MOST_PRIORITY} to {MOST_PRIORITY}"
        )
    return agreed("batchPolicy.priority", PRIORITY_TAG, by_member, int(tag))


def agreed(member: str, tag: str, by_member: _Value | None, by_tag: _Value) -> _Value:
    """Returns the value that a request gives by a tag, after checking that the request's member is absent or equal.

    Raises:
        InvalidParameterException: The member has another value.
    """
    if by_member is not None and by_member != by_tag:
        raise InvalidParameterException(
            f"{member} is {by_member!r}, but tags.{tag} is {by_tag!r}; leave one of them out"
        )
    return by_tag
