"""The operations by what they are about, in the order in which one needs them."""

from collections.abc import Mapping

from .operations import (
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
from .wire.operation_shape import OperationShape

OPERATION_GROUPS: Mapping[str, tuple[OperationShape, ...]] = {
    "World templates": world_templates.OPERATIONS,
    "World generation jobs": world_generation_jobs.OPERATIONS,
    "Worlds": worlds.OPERATIONS,
    "World export jobs": world_export_jobs.OPERATIONS,
    "Robot applications": robot_applications.OPERATIONS,
    "Simulation applications": simulation_applications.OPERATIONS,
    "Simulation jobs": simulation_jobs.OPERATIONS,
    "Simulation job batches": simulation_job_batches.OPERATIONS,
    "Fleets": fleets.OPERATIONS,
    "Robots": robots.OPERATIONS,
    "Deployment jobs": deployment_jobs.OPERATIONS,
    "Tags": tags.OPERATIONS,
}
"""By the title of their group."""
