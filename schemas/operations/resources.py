"""The resources that operations are about: the one list from which the registries of shapes and handlers are made.

A resource is a module here, with the shapes of its operations, and one in `tasks/operations`, with their handlers;
both have its name.
"""

from collections.abc import Mapping
from types import ModuleType

from ..wire.operation_shape import OperationShape
from . import (
    deployment_jobs,
    fleets,
    robot_applications,
    robots,
    simulation_applications,
    simulation_job_batches,
    simulation_jobs,
    tags,
    world_export_jobs,
    world_generation_jobs,
    world_templates,
    worlds,
)

_MODULES: Mapping[str, ModuleType] = {
    "World templates": world_templates,
    "World generation jobs": world_generation_jobs,
    "Worlds": worlds,
    "World export jobs": world_export_jobs,
    "Robot applications": robot_applications,
    "Simulation applications": simulation_applications,
    "Simulation jobs": simulation_jobs,
    "Simulation job batches": simulation_job_batches,
    "Fleets": fleets,
    "Robots": robots,
    "Deployment jobs": deployment_jobs,
    "Tags": tags,
}

OPERATION_GROUPS: Mapping[str, tuple[OperationShape, ...]] = {
    title: module.OPERATIONS for title, module in _MODULES.items()
}
"""The operations by what they are about, in the order in which one needs them."""

RESOURCES: tuple[str, ...] = tuple(sorted(module.__name__.rpartition(".")[2] for module in _MODULES.values()))
"""Names of the resources' modules."""
