"""Runs that are killed and go on from their last checkpoint as if nothing had been."""

import itertools
import json
import math
import os
import pickle
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import BUNDLES
from mcap.reader import make_reader

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ApplicationRole, RunStop
from prefect_robomaker.schemas.runs.provenance import Provenance
from prefect_robomaker.tasks.runtime.states import checkpoint_files, checkpoints
from prefect_robomaker.tasks.runtime.states.checkpoint_files import CheckpointError, last_checkpoint, resumable_plan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

SWINGER = BUNDLES / "swinger"


@pytest.fixture
def swing(make_plan: Callable[..., RunPlan], tmp_path: Path) -> Callable[..., RunPlan]:
    """Plans a run of the pendulum with checkpoints every half second simulated."""

    def plan(run_id: str = "run-1", variables: dict[str, str] | None = None, **members: Any) -> RunPlan:
        roles: tuple[ApplicationRole, ...] = ("simulation", "robot")
        applications = {
            f"{role}_application": ApplicationPlan(
                role=role,
                name=role,
                attribute=f"swinger.{factory}",
                path=SWINGER,
                environment_variables=variables or {},
            )
            for role, factory in zip(roles, ("make_environment", "make_agent"), strict=True)
        }
        kept = {"checkpoint_dir": tmp_path / run_id / "checkpoints", "checkpoint_every_s": 0.5}
        return make_plan(run_id=run_id, **{**applications, **kept, **members})

    return plan


def result_of(plan: RunPlan) -> RunResult:
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


def messages_of(plan: RunPlan) -> list[tuple[str, int, bytes]]:
    with (plan.output_dir / "recording.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        messages = [(channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()]
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(messages)
    return messages


def broken_and_resumed(launcher: Launcher, plan: RunPlan) -> RunPlan:
    """Runs a plan that is killed on the way, and goes on as a job worker does that finds it."""
    outcome = launcher.run(plan, lambda: None)
    assert outcome.status == "Failed"
    assert not outcome.finished
    assert plan.checkpoint_dir is not None
    found, _ = resumable_plan(plan.checkpoint_dir)
    assert launcher.run(found, lambda: None).status == "Completed"
    return found


def test_a_killed_run_goes_on_to_the_bit(launcher: Launcher, swing: Callable[..., RunPlan]) -> None:
    slow = {"SLEEP_S": "0.001"}
    whole, broken = swing("whole", slow), swing("broken", {**slow, "KILL_AT": "150"})
    assert launcher.run(whole, lambda: None).status == "Completed"
    broken_and_resumed(launcher, broken)

    one, other = result_of(whole), result_of(broken)
    assert one.state_digest == other.state_digest
    assert (one.verdict, one.metrics, one.requirements, one.sim_time_s) == (
        other.verdict, other.metrics, other.requirements, other.sim_time_s,
    )  # fmt: skip
    assert messages_of(whole) == messages_of(broken)
    provenance = Provenance.model_validate_json((broken.output_dir / "provenance.json").read_bytes())
    [resumed_at_s] = provenance.resumed_at_s
    assert 0.5 <= resumed_at_s <= 3.0
    # The agent was made twice, but what was written before stays.
    assert (broken.output_dir / "logs" / "stdout.log").read_text() == "agent begins\n" * 2
    assert 1 <= len(list((broken.checkpoint_dir or Path()).glob("checkpoint-*.bin"))) <= checkpoint_files.KEPT


def test_time_that_was_used_counts(launcher: Launcher, swing: Callable[..., RunPlan]) -> None:
    plan = swing(variables={"SLEEP_S": "0.005", "KILL_AT": "240", "TIME_LIMIT_S": "3600"}, max_duration_s=600.0)
    assert launcher.run(plan, lambda: None).status == "Failed"
    used_s = checkpoint_files.wall_time_used_s(plan)
    assert plan.checkpoint_dir is not None
    folder, before = plan.checkpoint_dir, last_checkpoint(plan.checkpoint_dir)
    assert before is not None
    assert (
        used_s >= 0.005 * before[1].steps > 0
    )  # each step sleeps; how far the last checkpoint got is the disk's doing
    plan = plan.model_copy(update={"max_duration_s": used_s + 0.1})
    asked = itertools.count()
    outcome = launcher.run(
        plan,
        lambda: RunStop.CANCELED if next(asked) == 300 else None,
        # By this clock half a second goes by at once when the run has gone on, and no more.
        clock=lambda: 0.0 if last_checkpoint(folder) == before else 0.5,
    )
    assert outcome.timed_out
    assert result_of(plan).wall_time_s > used_s


def test_a_checkpoint_that_was_cut_off_is_passed_over(launcher: Launcher, swing: Callable[..., RunPlan]) -> None:
    plan = swing(variables={"SLEEP_S": "0.001", "KILL_AT": "150"})
    launcher.run(plan, lambda: None)
    assert plan.checkpoint_dir is not None
    older = sorted(plan.checkpoint_dir.glob("checkpoint-*.bin"))[-1]
    (plan.checkpoint_dir / "checkpoint-00000099.bin").write_bytes(older.read_bytes()[:-1])
    found = last_checkpoint(plan.checkpoint_dir)
    assert found is not None
    assert found[0] == older
    whole = swing("whole", {"SLEEP_S": "0.001"})
    launcher.run(whole, lambda: None)
    assert launcher.run(plan, lambda: None).status == "Completed"
    assert result_of(plan).state_digest == result_of(whole).state_digest


@pytest.mark.parametrize(
    "broken", ["recording.mcap", *(pytest.param(name, marks=pytest.mark.deep) for name in ("digest.bin", "pickle"))]
)
def test_what_cannot_be_continued_begins_anew_and_says_why(
    launcher: Launcher, swing: Callable[..., RunPlan], broken: str
) -> None:
    plan = swing(variables={"SLEEP_S": "0.001", "KILL_AT": "150"})
    launcher.run(plan, lambda: None)
    assert plan.checkpoint_dir is not None
    if broken == "pickle":
        newest = sorted(plan.checkpoint_dir.glob("checkpoint-*.bin"))[-1]
        header = json.loads(newest.read_bytes().partition(b"\n")[0])
        payload = pickle.dumps({"data": None})
        about = {"payload_bytes": len(payload), "payload_crc32": zlib.crc32(payload)}
        newest.write_bytes(json.dumps({**header, **about}).encode() + b"\n" + payload)
    else:
        os.truncate(plan.output_dir / broken, 10)
    whole = swing("whole", {"SLEEP_S": "0.001"})
    launcher.run(whole, lambda: None)

    assert launcher.run(plan, lambda: None).status == "Completed"

    assert result_of(plan).state_digest == result_of(whole).state_digest
    assert messages_of(plan) == messages_of(whole)
    said = (plan.output_dir / "logs" / "stderr.log").read_text()
    assert "The run begins anew: its last checkpoint cannot be continued from: " in said


def test_what_has_not_opted_in_is_named(launcher: Launcher, swing: Callable[..., RunPlan]) -> None:
    plan = swing(variables={"CLOSED": "1"})
    assert launcher.run(plan, lambda: None).status == "Completed"
    assert plan.checkpoint_dir is not None
    with pytest.raises(CheckpointError, match=r"^the environment \(ClosedSwinging\) has no state\(\) and restore\(\)$"):
        resumable_plan(plan.checkpoint_dir)


def test_a_run_that_somebody_else_carries_out_is_left_alone(tmp_path: Path, swing: Callable[..., RunPlan]) -> None:
    plan = swing()
    first = checkpoints.Checkpointer(plan, None)  # type: ignore[arg-type]
    with pytest.raises(CheckpointError, match="another process still runs it"):
        checkpoints.Checkpointer(plan, None)  # type: ignore[arg-type]
    first.close()
    checkpoints.Checkpointer(plan, None).close()  # type: ignore[arg-type]


def test_checkpoints_of_a_run_that_somebody_else_carries_out_stay(
    launcher: Launcher, swing: Callable[..., RunPlan]
) -> None:
    plan = swing(variables={"SLEEP_S": "0.001", "KILL_AT": "150"})
    launcher.run(plan, lambda: None)
    assert plan.checkpoint_dir is not None
    there = checkpoint_files.checkpoints_in(plan.checkpoint_dir)
    lock = checkpoint_files.take_lock(plan.checkpoint_dir / checkpoint_files.LOCK_FILE)
    try:
        outcome = launcher.run(plan, lambda: None)
    finally:
        os.close(lock)
    assert "another process still runs it" in (outcome.failure_reason or "")
    assert checkpoint_files.checkpoints_in(plan.checkpoint_dir) == there != []


def test_what_stands_where_checkpoints_are_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "checkpoint-00000001.bin")
    os.mkfifo(tmp_path / "plan.json")
    assert last_checkpoint(tmp_path) is None
    with pytest.raises(CheckpointError, match="no checkpoints of it"):
        resumable_plan(tmp_path)


@pytest.mark.parametrize("wall_time_s", [-1.0, math.nan])
def test_no_run_has_taken_less_than_no_time(tmp_path: Path, wall_time_s: float) -> None:
    numbers = {"sim_time_s": 1.0, "steps": 1, "wall_time_s": wall_time_s, "payload_bytes": 0, "payload_crc32": 0}
    (tmp_path / "checkpoint-00000001.bin").write_text(json.dumps(numbers).replace("NaN", '"NaN"') + "\n")
    assert last_checkpoint(tmp_path) is None


def test_without_checkpoints_nothing_is_kept(launcher: Launcher, swing: Callable[..., RunPlan]) -> None:
    plan = swing(checkpoint_every_s=None)
    assert launcher.run(plan, lambda: None).status == "Completed"
    assert plan.checkpoint_dir is not None
    assert not plan.checkpoint_dir.exists()
    with pytest.raises(CheckpointError, match="no checkpoints of it are on this machine"):
        resumable_plan(plan.checkpoint_dir)
