"""Jobs whose trials have axes: values in the table, every trial repeated to the bit, and what is refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.swing_fixtures import outputs_of

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.runs.trial_rows import TrialsSummary
from prefect_robomaker.tasks.inspection.replays import reproduce_run, verify_run
from prefect_robomaker.tasks.runtime.trials import completion
from prefect_robomaker.tasks.service.service import Service

Simulate = Callable[..., dict[str, Any]]
Row = dict[str, Any]

DRAWN: dict[str, Any] = {
    "seeds": 2,
    "design": "sobol",
    "points": 4,
    "axes": {
        "mass": {"kind": "robot_mass", "range": [0.5, 2]},
        "gain": {"kind": "motor_gain", "normal": {"mean": 1, "std": 0.2, "low": 0.5}},
        "LIMIT": {"kind": "variable", "values": ["0.3", "9"]},
    },
    "include": [{}, {"mass": 1, "gain": 1}, {"mass": 1.5}],
}


def rows_of(service: Service, job: dict[str, Any]) -> list[Row]:
    return pq.read_table(outputs_of(service, job) / "trials.parquet").to_pylist()


def test_rows_have_the_values_and_any_is_repeated(service: Service, swing: Simulate) -> None:
    job = swing(seed=3, job={"trials": DRAWN}, TIME_LIMIT_S="1")
    plain = swing(seed=4, TIME_LIMIT_S="1")

    rows = rows_of(service, job)
    assert [row["seed"] for row in rows] == [3, 4] * 7
    assert len({(row["axis.mass"], row["axis.gain"]) for row in rows[:8]}) == 4
    assert rows[8]["axis.mass"] is None
    assert [row["axis.LIMIT"] for row in rows[8:]] == [None] * 6
    assert len({row["model_sha256"] for row in rows}) == 6  # four points, as built, and heavier
    # As built, and with factors of 1, it is the run of a job without axes.
    digest = RunResult.model_validate_json((outputs_of(service, plain) / "result.json").read_bytes()).state_digest
    assert [row["state_digest"] for row in (rows[9], rows[11])] == [digest, digest]
    assert len({row["state_digest"] for row in rows}) == 12
    for number in (6, 12):
        answer = verify_run(job["arn"], service, trial=number)
        assert answer.answer == "bit-identical", answer
        assert answer.digest_again == rows[number]["state_digest"]
    # What is recorded is the trial again.
    failing = next(row["trial"] for row in rows if row["verdict"] == "FAIL")
    folder = outputs_of(service, job) / f"trials/{failing:06d}"
    again = RunResult.model_validate_json((folder / "result.json").read_bytes())
    assert again.state_digest == rows[failing]["state_digest"]
    # Its trials are counted by axis.
    summary = TrialsSummary.of(RunResult.model_validate_json((outputs_of(service, job) / "result.json").read_bytes()))
    assert summary is not None
    assert summary.cells == []  # no point comes twice
    parts = {(each.axis, each.part): each.total for each in summary.axes}
    assert [parts["LIMIT", part] for part in ("0.3", "9", "as built")] == [4, 4, 6]
    assert parts["mass", "as built"] == 2
    assert sum(total for (axis, _), total in parts.items() if axis == "mass") == 14
    assert parts["mass", "0.8 to 1.1"] >= 2  # the one that was included is there


@pytest.mark.deep
def test_a_trial_is_taken_apart(service: Service, swing: Simulate, tmp_path: Path) -> None:
    job = swing(seed=3, job={"trials": DRAWN}, TIME_LIMIT_S="1")
    failing = next(row["trial"] for row in rows_of(service, job) if row["verdict"] == "FAIL")
    made = reproduce_run(job["arn"], tmp_path / "repro", service, "none", trial=failing)
    assert (made.ending, made.same_ending) == ("ended with verdict FAIL (low)", True)


@pytest.mark.deep
def test_a_table_of_other_points_is_repeated_by_its_own(
    service: Service, swing: Simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another release of scipy may draw other points than those that a stored run had."""
    from prefect_robomaker.schemas.runs import trial_designs as planned
    from prefect_robomaker.schemas.runs.trials import Trials

    job = swing(seed=3, job={"trials": DRAWN}, TIME_LIMIT_S="1")
    rows = rows_of(service, job)

    draw = planned.point
    monkeypatch.setattr(planned, "point", lambda axes, design, points, seed, number: {
        **draw(axes, design, points, seed, number), "mass": 0.77
    })  # fmt: skip
    assert Trials.model_validate(DRAWN).trial(1, 3).axes["mass"] == 0.77

    answer = verify_run(job["arn"], service, trial=1)
    assert (answer.answer, answer.digest_again) == ("bit-identical", rows[1]["state_digest"])


@pytest.mark.parametrize(
    ("axis", "said"),
    [
        ({"kind": "lidar_dropout", "values": [0, 0.1]},
         "trials.axes.axis: lidar_dropout cannot be applied: the environment (Swinging) has no lidar"),
        ({"kind": "motor_delay_s", "values": [0, 0.1]},
         "trials.axes.axis: motor_delay_s cannot be applied: the environment (Swinging) has no commands of a robot"),
    ],
)  # fmt: skip
def test_an_axis_that_cannot_be_applied_fails_the_job(
    service: Service, swing: Simulate, axis: dict[str, Any], said: str
) -> None:
    trials = {"seeds": 2, "axes": {"axis": axis}}
    job = swing(job={"trials": trials}, TIME_LIMIT_S="0.1")
    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidInput")
    assert said in job["failureReason"]
    assert not (outputs_of(service, job) / "result.json").exists()
    assert completion.read_row(outputs_of(service, job) / "trials.parquet", 0) is None
