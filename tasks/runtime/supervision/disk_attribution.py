"""Attributes disk use to containers, measured after they have ended."""

from dataclasses import replace

from ....schemas.runs.plan import RunPlan
from ..limits.disk_use import disk_meter
from ..limits.disk_walk import files_below
from .outcomes import Crash, Exit


def attribute_disk_use(ended: Exit, plan: RunPlan) -> Exit:
    """Measures the folders of a run of containers a last time, after the containers have ended.

    While they run, their root user may have folders that other users cannot read.

    Args:
        ended: How the run ended, by itself.
        plan: The run.

    Returns:
        The same, or a crash of the container that has most files, if the run wrote too much.
    """
    containers = [program for program in plan.programs if program.cleanup_argv is not None]
    if not containers or ended.crash is not None or (said := disk_meter(plan).last_look()) is None:
        return ended
    held = [sum(file.size_bytes for file in files_below([each.folder]) if file is not None) for each in containers]
    most = containers[held.index(max(held))]
    return replace(ended, crash=Crash(most.role, f"used too much: {said}", most.name))
