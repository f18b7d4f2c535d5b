"""Runs that are ordered: how many at once, whether one goes on, and what becomes known of it."""

import fcntl
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.deployments.spec_runs.spec_runs import (
    MOST_AT_ONCE,
    SpecRuns,
    Standing,
    StandingFile,
    StepStanding,
    read_standing,
)
from prefect_robomaker.schemas.reports.progress import Note, StepEnded, StepProgress, StepStarted
from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import ThrottlingException
from prefect_robomaker.tasks.nights import taking_up
from prefect_robomaker.tasks.nights.kept_answers import KeptAnswers

STANDING = Standing(name="one", steps=[StepStanding(name="drive", operation="StartSimulationJobBatch")])


def order(number: int = 0) -> Order:
    run_id = f"one-20260302T{number:09}"
    return Order(run_id=run_id, text="a: 1", filename="one.yaml", spec_path="one.yaml", command=["true"])


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the place of a run: what reads its order, and goes on until it is asked to end."""
    (tmp_path / "stand_in.py").write_text(
        "import json, pathlib, sys, time\n"
        "order = json.load(sys.stdin)\n"
        "print(order['text'], file=sys.stderr, flush=True)\n"
        f"cancel = pathlib.Path({str(tmp_path)!r}, 'runs', order['run_id'], 'cancel')\n"
        "while not cancel.exists(): time.sleep(0.01)\n"
    )
    monkeypatch.setattr(taking_up, "PROGRAM", "stand_in")


def test_a_run_goes_on_until_its_process_has_ended(tmp_path: Path, program: None) -> None:
    del program
    runs, others = SpecRuns(tmp_path, {"PYTHONPATH": str(tmp_path)}), SpecRuns(tmp_path, {})
    run = order()
    assert not others.is_going(run.run_id)
    runs.begin(run, STANDING)
    assert (others.is_going(run.run_id), others.going(), others.standing(run.run_id)) == (True, [run.run_id], STANDING)
    wait_for(lambda: others.last_words(run.run_id) == "a: 1", "its order on its input")
    others.cancel(run.run_id)
    wait_for(lambda: not others.is_going(run.run_id), "its end")
    assert others.going() == []


def test_only_some_run_at_once(tmp_path: Path, program: None) -> None:
    del program
    runs = SpecRuns(tmp_path, {"PYTHONPATH": str(tmp_path)})
    for number in range(MOST_AT_ONCE):
        runs.begin(order(number), STANDING)
    with pytest.raises(ThrottlingException, match="wait until one has ended"):
        SpecRuns(tmp_path, {}).begin(order(9), STANDING)  # as after a restart: those of another server count, too
    assert runs.standing(order(9).run_id) is None
    for run_id in runs.going():
        runs.cancel(run_id)
    wait_for(lambda: not runs.going(), "their ends")
    runs.begin(order(9), STANDING)
    runs.cancel(order(9).run_id)
    wait_for(lambda: not runs.going(), "its end")


def test_a_lock_that_is_held_means_that_the_run_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / order().run_id
    folder.mkdir(parents=True)
    runs = SpecRuns(tmp_path, {})
    with (folder / "running.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert runs.is_going(order().run_id)
    assert not runs.is_going(order().run_id)


def test_a_run_whose_process_was_killed_is_taken_up(tmp_path: Path, program: None) -> None:
    del program
    runs, others = SpecRuns(tmp_path, {}), SpecRuns(tmp_path, {"PYTHONPATH": str(tmp_path)})
    run = order()
    folder = tmp_path / "runs" / run.run_id
    runs.begin(run, STANDING)  # its program is not found
    wait_for(lambda: not runs.is_going(run.run_id), "its death")
    assert (folder / "order.json").stat().st_mode & 0o077 == 0
    assert others.has_broken_off(run.run_id)
    assert others.take_up(run.run_id)
    assert others.going() == [run.run_id]
    assert not others.has_broken_off(run.run_id)
    assert not others.take_up(run.run_id)
    wait_for(lambda: others.last_words(run.run_id).endswith("\na: 1"), "its order on its input")
    for name in ("order.json", "running.lock"):  # as its process does at its end
        (folder / name).unlink()
    others.cancel(run.run_id)
    wait_for(lambda: not others.is_going(run.run_id), "its end")
    assert not others.has_broken_off(run.run_id)
    assert not others.take_up(run.run_id)
    assert not others.take_up("none-20260302T000000000")


def test_a_step_is_carried_out_once_whichever_process_asks(tmp_path: Path) -> None:
    made: list[str] = []

    def permit(step: Any, request: dict[str, Any], carry_out: Any) -> dict[str, Any]:
        made.append(f"{step.name} {request['n']}")
        return carry_out()

    def refuse() -> dict[str, Any]:
        raise ThrottlingException("later")

    spec = load_spec("{version: 1, name: one, steps: {a: {operation: ListWorlds}, b: {operation: ListWorlds}}}", "one")
    first, second = spec.steps["a"], spec.steps["b"]
    for _ in range(2):
        answers = KeptAnswers(tmp_path, permit)
        told = [answers(first, {"n": n}, lambda n=n: {"arn": f"a{n}"}) for n in (1, 2)]
        assert [each["arn"] for each in told] == ["a1", "a2"]
    answers = KeptAnswers(tmp_path, permit)
    with pytest.raises(ThrottlingException):  # not answered; it is asked again
        answers(second, {"n": 1}, refuse)
    answers(second, {"n": 1}, lambda: {"at": datetime(2026, 1, 1, tzinfo=UTC)})
    assert KeptAnswers(tmp_path, permit)(second, {"n": 1}, refuse) == {"at": "2026-01-01 00:00:00+00:00"}
    assert made == ["a 1", "a 2", "b 1", "b 1"]
    assert (tmp_path / "answers.jsonl").stat().st_mode & 0o077 == 0


def test_progress_is_in_the_folder(tmp_path: Path) -> None:
    listener = StandingFile(tmp_path, STANDING)
    events: list[Any] = [
        StepStarted("drive", "StartSimulationJobBatch"),
        StepProgress("drive", {"completed": 2, "running": 1}, 5),
        Note("the store answers"),
    ]
    for event in events:
        listener(event)
    wait_for(lambda: read_standing(tmp_path) is not None, "what is known, a moment later")
    known = read_standing(tmp_path)
    assert known is not None
    [step] = known.steps
    assert (step.status, step.ended, step.total, known.note) == ("running", 2, 5, "the store answers")
    listener(StepEnded("drive", "Failed", 1.0, "boom"))
    listener.broke("it was cancelled")
    listener.write()
    known = read_standing(tmp_path)
    assert known is not None
    assert (known.steps[0].status, known.steps[0].detail, known.problem) == ("Failed", "boom", "it was cancelled")


def test_other_folders_are_no_ordered_runs(tmp_path: Path) -> None:
    (tmp_path / "standing.json").write_text("{")
    assert read_standing(tmp_path) is None
    assert read_standing(tmp_path / "none") is None
