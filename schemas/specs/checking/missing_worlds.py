"""Problems of jobs whose applications need a world, and that name none."""

from collections.abc import Iterator, Mapping

from ...runs.plan import why_a_world
from ...wire.errors import Problem
from ...wire.request_problems import Location, path_text
from ..specification import CheckedStep
from ..yaml_nodes import ListNode, MappingNode, child, node_at, plain, value_place
from .written_requests import WrittenRequest, written_requests

_SIMULATION, _ROBOT = "simulationApplications", "robotApplications"
_OWN_PROGRAM = ("command", "packageName", "launchFile")
"""Members of a launch configuration that start something else than the application's own code."""
_MAKERS = ("CreateRobotApplication", "CreateSimulationApplication")


def missing_world_problems(steps: Mapping[str, CheckedStep]) -> Iterator[Problem]:
    """Yields the jobs of a specification that would fail when they start, since they name no world.

    Applications of the specification's own may have the name of one that comes along; they are left out.

    Args:
        steps: Steps, whose inputs may have other problems.
    """
    own = {
        str(plain(name)) for step in steps.values() if step.operation in _MAKERS and (name := child(step.input, "name"))
    }
    for step in steps.values():
        for request in written_requests(step):
            reason = next(_reasons(request, own), None)
            given, config = node_at(request.node, (_SIMULATION,)), node_at(request.node, (_SIMULATION, 0))
            worlds = node_at(request.node, (_SIMULATION, 0, "worldConfigs"))
            is_empty = worlds is None or (isinstance(worlds, ListNode) and not worlds.items)
            if reason is None or not is_empty or (given is not None and not isinstance(config, MappingNode)):
                continue  # which is well, told already, or made by references
            at: Location = (_SIMULATION,) if given is None else (_SIMULATION, 0, "worldConfigs")
            where = (*request.location, *at)
            yield Problem(value_place(step.input, where), path_text((*step.location, *where)), f"is missing: {reason}")


def _reasons(request: WrittenRequest, own: set[str]) -> Iterator[str]:
    """Yields why a request's applications need a world."""
    for member in (_SIMULATION, _ROBOT):
        config = node_at(request.node, (member, 0))
        launch = child(config, "launchConfig") if config is not None else None
        if launch is not None and any(child(launch, each) is not None for each in _OWN_PROGRAM):
            continue
        if member == _ROBOT and child(request.node, "policy") is not None:
            continue  # it drives in place of the application's own code
        for _, name in request.values((member, 0, "application")):
            if name not in own and (why := why_a_world(name)) is not None:
                yield why
