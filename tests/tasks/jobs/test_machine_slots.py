"""A machine runs no more jobs at once than its setting says, in whatever threads and processes."""

import subprocess
import sys

from helpers.processes import started, wait_for

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.jobs.machine_slots import MachineSlots

_HOLD = """
import os, sys
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.jobs.machine_slots import MachineSlots
assert MachineSlots(Settings.from_environment(os.environ)).take() is not None
print("held", flush=True)
sys.stdin.read()
"""


def test_as_many_slots_as_the_setting_says(settings: Settings) -> None:
    slots = MachineSlots(settings.model_copy(update={"max_jobs": 2}))
    first, second = slots.take(), slots.take()
    assert first is not None
    assert second is not None
    assert slots.take() is None

    slots.give_back(first)
    third = slots.take()
    assert third is not None
    slots.give_back(second)
    slots.give_back(third)


def test_waiting_for_a_slot_ends_when_the_job_has_to_stop(settings: Settings) -> None:
    slots = MachineSlots(settings.model_copy(update={"max_jobs": 1}))
    asked: list[bool] = []

    def should_stop() -> bool:
        asked.append(True)
        return len(asked) > 2

    with slots.hold(should_stop) as first, slots.hold(should_stop) as second:
        assert (first, second) == (True, False)
    with slots.hold(lambda: True) as third:
        assert third


def test_other_processes_count_and_those_that_die_do_not(settings: Settings) -> None:
    settings = settings.model_copy(update={"max_jobs": 1})
    slots = MachineSlots(settings)
    variables = {"ROBOMAKER_HOME": str(settings.home), "ROBOMAKER_MAX_JOBS": "1"}
    with started([sys.executable, "-c", _HOLD], variables, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        assert slots.take() is None
        process.kill()
        slot = wait_for(slots.take, "the slot of a dead process")
    assert slot is not None
    slots.give_back(slot)
