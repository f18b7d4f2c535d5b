"""Trials of what turns out to be a program when its job is planned, such as a container."""

from pathlib import Path

import pytest

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.simulations.planning.run_plans import _check_trials


def plan(tmp_path: Path, attribute: str | None) -> RunPlan:
    return RunPlan(
        job_id="sim-1",
        job_arn="arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1",
        run_id="run",
        seed=1,
        max_duration_s=60.0,
        work_dir=tmp_path,
        output_dir=tmp_path,
        trials=Trials(seeds=2),
        simulation_application=ApplicationPlan(role="simulation", name="arena", attribute=attribute),
    )


def test_they_are_refused(tmp_path: Path) -> None:
    _check_trials(plan(tmp_path, "arena.make_environment"))
    with pytest.raises(LaunchError, match="trials: the simulation application is a program") as refused:
        _check_trials(plan(tmp_path, None))
    assert refused.value.failure_code == "InvalidInput"
