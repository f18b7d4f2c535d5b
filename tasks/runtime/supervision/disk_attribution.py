"""What containers wrote, measured once their files can be read."""

from dataclasses import replace

from ....schemas.runs.plan import RunPlan
from ..limits.disk_use import disk_meter
from ..limits.disk_walk import files_below
from .outcomes import Crash, Exit


def attribute_disk_use(ended: Exit, plan: RunPlan) -> Exit:
    """Looks a last time at the folders of a run of containers, which are settled by now.

    While they run, their root may have folders that nobody else can look into.

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
