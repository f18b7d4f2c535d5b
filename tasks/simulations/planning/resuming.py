"""Whether and how often a job's run is kept, and whether one that a dead job worker left can be continued."""

import logging
import math
from collections.abc import Mapping
from pathlib import Path

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ....schemas.runs.variables import number_in
from ....schemas.wire.errors import LaunchError
from ...catalog import Resource
from ...runtime.states.checkpoint_files import CheckpointError, last_checkpoint, resumable_plan
from ..environment.run_environment import run_sandbox

CHECKPOINTS_FOLDER = "checkpoints"
EVERY_VARIABLE = "ROBOMAKER_CHECKPOINT_EVERY_S"

_DEFAULT_S = 5.0
_SHOWN = 200

_logger = logging.getLogger(__name__)


def checkpoint_every_s(application: ApplicationPlan | None) -> float | None:
    """Simulated time between two checkpoints of a run; none when it makes none.

    Args:
        application: the simulation application, whose launch configuration may say so: seconds, or 0 for none.

    Raises:
        LaunchError: it says something else.
    """
    variables: Mapping[str, str] = application.environment_variables if application else {}
    text = variables.get(EVERY_VARIABLE)
    if text is None:
        return _DEFAULT_S
    every_s = number_in(text)
    if not 0 <= every_s < math.inf:
        raise LaunchError(
            f"{EVERY_VARIABLE} is {text!r}; seconds of simulated time, or 0 for no checkpoints, would be right"
        )
    return every_s or None


def plan_to_resume(job: Resource, folder: Path) -> RunPlan | None:
    """The plan of the run that a job was in when its job worker died, if it can be continued here; else says why not.

    Args:
        job: the job.
        folder: of that run.
    """
    if job.status != "Running":
        return None
    try:
        plan, last = resumable_plan(folder / CHECKPOINTS_FOLDER)
        _check_own(plan, job, folder)
    except CheckpointError as error:
        _logger.warning("%s is run from the start again: %s", job.arn, error)
        return None
    _logger.info("%s goes on from %.3f s of simulated time, where its last checkpoint is", job.arn, last.sim_time_s)
    return plan


def reached_s(folder: Path) -> float:
    """How far a run has come: simulated time of its last checkpoint, in seconds; 0 before the first.

    Args:
        folder: of the run.
    """
    last = last_checkpoint(folder / CHECKPOINTS_FOLDER)
    return last[1].sim_time_s if last else 0.0


def _check_own(plan: RunPlan, job: Resource, folder: Path) -> None:
    """Checks that a plan is that of a run: its applications could write to where it was.

    Raises:
        CheckpointError: it names another run, folders of others, more time, or programs, with which no run is
            continued.
    """
    folder = folder.absolute()
    expected = {
        "job_id": job.id,
        "run_id": folder.name,
        "max_duration_s": float(SimulationJobDocument.of(job).request["maxJobDurationInSeconds"]),
        "work_dir": folder / "work",
        "output_dir": folder / "output",
        "root_dir": run_sandbox(folder).root,
        "checkpoint_dir": folder / CHECKPOINTS_FOLDER,
        "programs": [],
    }
    for name, value in expected.items():
        if (found := getattr(plan, name)) != value:
            raise CheckpointError(
                f"its plan was changed: {name} is {str(found)[:_SHOWN]!r} and has to be {str(value)!r}"
            )
