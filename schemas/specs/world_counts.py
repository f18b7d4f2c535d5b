"""Finds generation jobs of a specification that would fail, as they ask for more worlds than a job may make."""

from ..operations.world_generation_jobs import too_many_worlds
from ..wire.errors import Problem, SpecError
from ..wire.request_problems import path_text
from .model import CheckedSpec, CheckedStep
from .text import MappingNode, ScalarNode, value_place

_COUNT = "worldCount"
_MEMBERS = ("floorplanCount", "interiorCountPerFloorplan")


def check_world_counts(spec: CheckedSpec, most: int) -> None:
    """Refuses what the service itself would accept, and then fail; counts that only a run can tell pass.

    Args:
        spec: the specification.
        most: worlds that one job may make, see `ROBOMAKER_MAX_WORLDS_PER_JOB`.

    Raises:
        SpecError: a job asks for more.
    """
    problems = [problem for step in spec.steps.values() if (problem := _problem(step, most))]
    if problems:
        raise SpecError(problems)


def _problem(step: CheckedStep, most: int) -> Problem | None:
    count = step.input.entries.get(_COUNT) if isinstance(step.input, MappingNode) else None
    if step.operation != "CreateWorldGenerationJob" or not isinstance(count, MappingNode):
        return None
    members = [count.entries.get(member) for member in _MEMBERS]
    floorplans, interiors = (node.value if isinstance(node, ScalarNode) else None for node in members)
    if not isinstance(floorplans, int) or not isinstance(interiors, int):
        return None
    reason = too_many_worlds(floorplans, interiors, most)
    place = value_place(step.input, (_COUNT,))
    return Problem(place, path_text((*step.location, _COUNT)), reason) if reason else None
