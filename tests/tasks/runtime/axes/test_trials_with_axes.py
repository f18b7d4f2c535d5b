"""Trials with axes of every kind: each has the states that it has alone, and in a run of its own."""

from typing import Any

import pytest

from prefect_robomaker.schemas.runs.axes import AXIS_KINDS, subject_of
from prefect_robomaker.schemas.runs.plan import RunPlan, RunResult
from prefect_robomaker.schemas.runs.trial_rows import TrialRow, plan_of_trial
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.episode.progress import Progress
from prefect_robomaker.tasks.runtime.process.attempt import attempt
from prefect_robomaker.tasks.runtime.process.run_request import RunRequest
from prefect_robomaker.tasks.runtime.process.trial_runs import TrialStage

TRIALS = Trials.model_validate(
    {
        "seeds": 2,
        "design": "latin-hypercube",
        "points": 3,
        "axes": {
            "ROBOMAKER_SIM_TIME_LIMIT_S": {"kind": "variable", "values": ["8"]},
            "mass": {"kind": "robot_mass", "range": [0.8, 1.3]},
            "grip": {"kind": "robot_friction", "range": [0.5, 1.5]},
            "gain": {"kind": "motor_gain", "range": [0.8, 1.2]},
            "delay": {"kind": "motor_delay_s", "range": [0, 0.1]},
            "obeys": {"kind": "command_gain", "range": [0.5, 0.9]},
            "turns": {"kind": "turn_gain", "range": [0.8, 1.2]},
            "slip": {"kind": "wheel_slip", "range": [0.1, 0.4]},
            "drift": {"kind": "odometry_drift_std_m", "range": [0.01, 0.1]},
            "noise": {"kind": "lidar_noise_std_m", "range": [0.005, 0.03]},
            "bias": {"kind": "lidar_bias_m", "range": [-0.02, 0.02]},
            "dropout": {"kind": "lidar_dropout", "range": [0.3, 0.9]},
            "latency": {"kind": "lidar_latency_s", "range": [0, 0.3]},
        },
        "include": [{"ROBOMAKER_SIM_TIME_LIMIT_S": "8"}],
    }
)


class NeverStop:
    """Nobody stops the run."""

    reason = ""


@pytest.fixture
def plan(make_context: Any) -> RunPlan:
    """The plan of a job with these trials, in the hand-written flat."""
    return make_context().plan.model_copy(update={"trials": TRIALS, "seed": 4, "record": False})


def play(plan: RunPlan, *numbers: int) -> list[TrialRow]:
    stage = TrialStage(plan, Progress(), NeverStop())
    rows = [stage.play(TRIALS.trial(number, plan.seed)) for number in numbers]
    return [row for row in rows if row is not None]


def test_a_trial_does_not_depend_on_those_before_it(plan: RunPlan) -> None:
    assert {subject_of(axis.kind) for axis in (TRIALS.axes or {}).values()} == set(map(subject_of, AXIS_KINDS))
    rows = play(plan, *range(TRIALS.count))

    assert len({row.state_digest for row in rows}) == TRIALS.count == 8
    for number in (7, 3, 0):
        [alone] = play(plan, number)
        assert (alone.axes, alone.state_digest) == (rows[number].axes, rows[number].state_digest)

    own = plan_of_trial(plan, TRIALS.trial(3, plan.seed))
    attempt(RunRequest(plan=own, environment={}, import_path=[]), Progress(), NeverStop())
    result = RunResult.model_validate_json((own.output_dir / "result.json").read_bytes())
    assert result.state_digest == rows[3].state_digest
