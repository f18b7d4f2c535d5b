"""Runs whose process died: which there are, who finishes them, and when nobody does by himself."""

import os
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.schemas.job_owners import NeededEnvironment
from prefect_robomaker.schemas.reports.run_record import Interruption, Order
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.inspection.run_records import RECORD_NAME
from prefect_robomaker.tasks.nights import taking_up
from prefect_robomaker.tasks.nights.broken_off import MOST_INTERRUPTIONS, MOST_QUICK_DEATHS, BrokenOff, broken_off_runs
from prefect_robomaker.tasks.nights.open_runs import LOCK, ORDER, OpenRun, is_going, read_order
from prefect_robomaker.tasks.nights.taking_up import TakingUp

RUN = "night-20261127T020000000"
LIVING = """
import sys
from pathlib import Path
from prefect_robomaker.schemas.reports.run_record import Interruption
from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.tasks.nights.open_runs import OpenRun

run = OpenRun.begin(Path(sys.argv[1]), Order.model_validate_json(sys.stdin.readline()))
print("begun", flush=True)
sys.stdin.readline()
"""


def order(run_id: str = RUN, **members: Any) -> Order:
    return Order(run_id=run_id, text="a: 1", filename="a.yaml", spec_path="a.yaml", command=["true"], **members)


def other_machine() -> NeededEnvironment:
    """An environment that no process has: another version of a package."""
    return NeededEnvironment(machine="lab", python="/opt/lab", variables={}, packages={"helpers": "package abc"})


@pytest.fixture
def break_off(settings: Settings) -> Callable[..., Path]:
    """Has a run break off: a process begins it, and is killed."""

    def broken(made: Order | None = None) -> Path:
        made = made or order()
        folder = settings.home / "runs" / made.run_id
        folder.mkdir(parents=True)
        command = [sys.executable, "-c", LIVING, str(folder)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(made.model_dump_json() + "\n")
            process.stdin.flush()
            assert process.stdout.readline() == "begun\n"
            assert is_going(folder)
            assert broken_off_runs(settings) == []
            process.kill()
        return folder

    return broken


@pytest.fixture
def finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Puts a program in the place of the one that finishes runs; it writes down what it was given."""
    folder = tmp_path / "finished"
    folder.mkdir()
    (tmp_path / "stand_in.py").write_text(
        "import json, os, pathlib, sys\n"
        "order = json.load(sys.stdin)\n"
        f"pathlib.Path({str(folder)!r}, order['run_id']).write_text(' '.join(sys.argv[2:]))\n"
    )
    monkeypatch.setattr(taking_up, "PROGRAM", "stand_in")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return folder


def test_a_run_whose_process_is_killed_is_finished_once_and_says_who_died(
    settings: Settings, break_off: Callable[..., Path], finished: Path
) -> None:
    folder = break_off()
    [found] = broken_off_runs(settings)
    assert (found.run_id, found.why_left) == (RUN, "")
    assert "a Python program" in found.in_words()

    takers = [TakingUp(settings), TakingUp(settings)]
    assert [run for taker in takers for run in taker.look()] == [RUN]
    wait_for(lambda: (finished / RUN).exists(), "the process that finishes it")
    assert (finished / RUN).read_text() == "continued"
    kept = read_order(folder)
    assert kept is not None
    [interruption] = kept.interruptions
    assert interruption.lost is not None
    assert interruption.lost.process_id != os.getpid()
    assert interruption.lost_at <= interruption.continued_at

    # That process ends without a record: the next one waits, since what it lacked may be there in a minute.
    wait_for(lambda: not is_going(folder), "its end")
    assert takers[0].look() == []


def test_what_kills_each_process_is_not_tried_for_ever(settings: Settings, break_off: Callable[..., Path]) -> None:
    folder = break_off()
    for _ in range(MOST_QUICK_DEATHS):
        assert broken_off_runs(settings)[0].why_left == ""
        claimed = OpenRun.claim(folder)
        assert claimed is not None
        claimed.pass_on()  # to nobody: as if it died
    [found] = broken_off_runs(settings)
    assert "it has lost 4 processes" in found.why_left
    assert found.command == f"robomaker perform {RUN}"
    assert TakingUp(settings).look() == []


def test_services_that_are_restarted_again_and_again_are_not_what_kills_a_run(
    settings: Settings, break_off: Callable[..., Path]
) -> None:
    folder = break_off()
    kept = read_order(folder)
    assert kept is not None
    hours = [datetime.now(UTC) - timedelta(hours=number) for number in range(MOST_INTERRUPTIONS, 0, -1)]
    deaths = [Interruption(lost=None, lost_at=at - timedelta(seconds=9), continued_at=at) for at in hours]
    for count, why in ((MOST_INTERRUPTIONS - 1, ""), (MOST_INTERRUPTIONS, "it has lost 11 processes")):
        (folder / ORDER).write_text(kept.model_copy(update={"interruptions": deaths[:count]}).model_dump_json())
        [found] = broken_off_runs(settings)
        assert why in found.why_left
        assert bool(found.why_left) == bool(why)


def test_old_runs_and_those_of_other_environments_are_left_with_the_command_that_finishes_them(
    settings: Settings, break_off: Callable[..., Path]
) -> None:
    folder = break_off(order(needed=other_machine()))
    told: list[BrokenOff] = []
    taker = TakingUp(settings, tell=told.append)
    assert (taker.look(), taker.look()) == ([], [])
    [left] = told
    assert "package helpers has other files" in left.why_left
    assert left.place + left.command == f"on lab: /opt/lab/bin/robomaker perform {RUN}"

    later = datetime.now(UTC) + timedelta(hours=25)
    [old] = broken_off_runs(settings, later)
    assert "25 h ago" in old.why_left
    never = settings.model_copy(update={"finish_within_hours": 0})
    assert "ROBOMAKER_FINISH_WITHIN_HOURS is 0" in broken_off_runs(never)[0].why_left
    assert (folder / ORDER).stat().st_mode & 0o077 == 0


def test_the_run_of_a_deployment_is_left_to_its_prefect_worker_at_first(
    settings: Settings, break_off: Callable[..., Path], finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    break_off(order(deployment="7b0f9b52-4f5e-4a0c-9a51-0c4c5c3e9f10"))
    ordered: list[str] = []

    def order_flow_run(each: Order) -> bool:
        ordered.append(each.run_id)
        return True

    serve, worker = TakingUp(settings), TakingUp(settings, order_flow_run=order_flow_run)
    assert serve.look() == []
    assert worker.look() == [RUN]
    assert worker.look() == []  # it is ordered once
    assert ordered == [RUN]
    monkeypatch.setattr(taking_up, "_FIRST_ITS_WORKER_S", 0.0)
    assert serve.look() == [RUN]  # no Prefect worker came
    wait_for(lambda: (finished / RUN).exists(), "the process that finishes it")


def test_a_run_of_another_machine_is_dead_only_when_it_is_silent(
    settings: Settings, break_off: Callable[..., Path]
) -> None:
    folder = break_off()
    kept = read_order(folder)
    assert kept is not None
    assert kept.owner is not None
    elsewhere = kept.model_copy(update={"owner": kept.owner.model_copy(update={"machine": "another"})})
    (folder / ORDER).write_text(elsewhere.model_dump_json())
    assert broken_off_runs(settings) == []  # its file system may not tell of the lock
    assert len(broken_off_runs(settings, datetime.now(UTC) + timedelta(seconds=130))) == 1


def test_a_run_that_was_killed_while_it_cleaned_up_is_not_run_again(
    settings: Settings, break_off: Callable[..., Path]
) -> None:
    folder = break_off()
    (folder / RECORD_NAME).write_text("{}")
    assert broken_off_runs(settings) == []
    assert OpenRun.claim(folder) is None
    assert not {ORDER, LOCK} & {path.name for path in folder.iterdir()}


def test_orders_of_visitors_wait_for_a_server_that_knows_their_key(
    settings: Settings, break_off: Callable[..., Path]
) -> None:
    break_off(order(key_id="AKIA"))
    assert TakingUp(settings).look() == []
