"""A machine runs no more jobs at once than its setting says and has room for, in whatever threads and processes."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import ExitStack

import pytest
from helpers.processes import started, wait_for

from prefect_robomaker.schemas.runs.programs import Scarce
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.machine.machine_slots import MachineSlots, Turn, jobs_that_wait
from prefect_robomaker.tasks.machine.slot_files import SlotFiles, WaiterFiles

GB = 10**9

_HOLD = """
import os, sys
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.machine.machine_slots import MachineSlots
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
        assert first is not None
        assert second is None
    with slots.hold(lambda: True) as third:
        assert third is not None


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


@pytest.fixture
def roomy(settings: Settings) -> Settings:
    """Settings of a machine with two slots and all the room that there can be."""
    return settings.model_copy(update={"max_jobs": 2, "job_memory_mb": 0, "min_free_disk_mb": 0})


def never() -> bool:
    return False


def taken(slots: MachineSlots, name: str = "a job") -> int:
    slot = slots.take(name)
    assert slot is not None
    return slot


def waits(settings: Settings) -> list[str]:
    return [f"{record.name}: {record.why}" for record in jobs_that_wait(settings, os.getpid())]


def test_a_second_job_waits_for_memory_says_so_and_begins_once_there_is_some(roomy: Settings) -> None:
    settings = roomy.model_copy(update={"job_memory_mb": 500})
    available, told, now_s = [2 * GB], list[str](), [1000.0]

    def slots() -> MachineSlots:
        return MachineSlots(settings, tell=told.append, memory=lambda: available[0], clock=lambda: now_s[0])

    first, second = slots(), slots()
    available[0] = 0
    held = taken(first, "sim-1")  # one that is alone waits for no memory
    assert second.take("sim-2") is None
    assert told == []
    now_s[0] += 3.0
    assert second.take("sim-2") is None
    assert told == [
        "sim-2 waits: 0 MB of memory are available, of which jobs that have just begun may take 500 MB; another job "
        "begins with at least 500 MB (ROBOMAKER_JOB_MEMORY_MB)"
    ]
    available[0] = 999 * 10**6
    assert second.take("sim-2") is None, "the first has not had the time to take its memory"
    now_s[0] += 30.0
    other = taken(second, "sim-2")
    first.give_back(held)
    second.give_back(other)


def test_what_is_waited_for_is_shown_while_it_lasts_and_counted(roomy: Settings) -> None:
    settings, now_s, shown = roomy.model_copy(update={"job_memory_mb": 500}), [1000.0], list[Scarce | None]()
    available = [0]
    first, second = (
        MachineSlots(settings, name, watch=shown.append, memory=lambda: available[0], clock=lambda: now_s[0])
        for name in ("first", "second")
    )
    held = taken(first)

    for _ in range(5):
        assert second.take() is None
        now_s[0] += 1.0
    assert shown == ["memory"]
    available[0] = 2 * GB
    other = taken(second)

    assert shown == ["memory", None]
    assert second.waited_s() == {"memory": 5.0}
    assert second.waited_s({"memory": 2.0}) == {"memory": 3.0}
    assert first.waited_s() == {}
    first.give_back(held)
    second.give_back(other)


def test_all_who_waited_at_the_same_time_are_told_how_long(roomy: Settings) -> None:
    """Only one thread of a batch looks; the others wait behind it, and for the same."""
    settings = roomy.model_copy(update={"min_free_disk_mb": 200})
    free, turns = [0], list[Turn | None]()
    slots = MachineSlots(settings, "batch", disk=lambda _: free[0])

    def run() -> None:
        with slots.hold(never) as turn:
            turns.append(turn)

    threads = [threading.Thread(target=run) for _ in range(2)]
    for thread in threads:
        thread.start()
    wait_for(lambda: slots.waited_s().get("disk", 0.0) > 1.0, "the wait")
    free[0] = GB
    for thread in threads:
        thread.join()

    assert len(turns) == 2
    assert all(turn is not None and turn.waited_s["disk"] > 0.2 for turn in turns)


def test_a_job_waits_for_a_disk_that_is_all_but_full_also_when_it_is_alone(roomy: Settings) -> None:
    settings = roomy.model_copy(update={"min_free_disk_mb": 200})
    free = [100 * 10**6]
    slots = MachineSlots(settings, disk=lambda _: free[0])

    assert slots.take("sim-1") is None
    assert waits(settings) == [
        "sim-1: 100 MB are free on the disk of ROBOMAKER_HOME, and a job begins with at least 200 MB "
        "(ROBOMAKER_MIN_FREE_DISK_MB)"
    ]
    free[0] = GB
    slot = taken(slots, "sim-1")
    slots.give_back(slot)
    slots.leave()
    assert waits(settings) == []


def test_a_batch_that_only_waits_for_its_own_jobs_says_nothing(roomy: Settings) -> None:
    told, now_s = list[str](), [1000.0]
    slots = MachineSlots(roomy, "batch", tell=told.append, clock=lambda: now_s[0])
    other = MachineSlots(roomy, "other", tell=told.append, clock=lambda: now_s[0])
    assert slots.take() is not None
    assert slots.take() is not None

    for _ in range(5):
        now_s[0] += 1.0
        assert slots.take("request 2 of batch") is None
    assert (told, jobs_that_wait(roomy, os.getpid(), lambda: now_s[0])) == ([], [])
    for _ in range(5):
        now_s[0] += 1.0
        assert other.take("request 0 of other") is None
    assert told == ["request 0 of other waits: 2 jobs run on this machine, as many as ROBOMAKER_MAX_JOBS allows"]


def test_a_waiter_that_asks_no_more_holds_no_other_back(roomy: Settings) -> None:
    """As one whose process has died or is stopped."""
    settings, now_s = roomy.model_copy(update={"max_jobs": 1}), [1000.0]
    running, urgent, patient = (
        MachineSlots(settings, name, priority, clock=lambda: now_s[0])
        for name, priority in (("running", 0), ("urgent", 5), ("patient", 0))
    )
    slot = taken(running)
    assert urgent.take() is None
    running.give_back(slot)

    assert patient.take() is None
    now_s[0] += 2.0
    assert patient.take() is None
    now_s[0] += 2.0
    slot = taken(patient)
    patient.give_back(slot)


def test_one_that_leaves_holds_no_other_back(roomy: Settings) -> None:
    settings = roomy.model_copy(update={"max_jobs": 1})
    with MachineSlots(settings).hold(never):
        with MachineSlots(settings, "urgent", 5).hold(lambda: True) as held:
            assert held is None
        other = MachineSlots(settings, "other")
        assert other.take() is None
    slot = taken(other)
    other.give_back(slot)


def test_a_batch_that_wants_more_keeps_its_turn_between_two_jobs(roomy: Settings) -> None:
    settings, now_s = roomy.model_copy(update={"max_jobs": 1}), [1000.0]
    urgent, other = (
        MachineSlots(settings, name, priority, clock=lambda: now_s[0])
        for name, priority in (("urgent", 5), ("other", 0))
    )
    with urgent.hold(never, wants_more=lambda: True):
        assert other.take() is None
    assert other.take() is None, "the urgent batch is about to begin another job"
    with urgent.hold(never):
        assert other.take() is None
    other.give_back(taken(other))


def test_a_turn_that_is_kept_for_nothing_is_kept_for_seconds(roomy: Settings) -> None:
    settings, now_s = roomy.model_copy(update={"max_jobs": 1}), [1000.0]
    urgent, other = (
        MachineSlots(settings, name, priority, clock=lambda: now_s[0])
        for name, priority in (("urgent", 5), ("other", 0))
    )
    with urgent.hold(never, wants_more=lambda: True):
        pass
    assert other.take() is None
    now_s[0] += 4.0
    other.give_back(taken(other))


_BATCH = """
import os, sys, threading
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.machine.machine_slots import MachineSlots
slots = MachineSlots(Settings.from_environment(os.environ), sys.argv[1], int(sys.argv[2]))
ends = threading.Semaphore(0)

def run():
    with slots.hold(lambda: False):
        ends.acquire()

for line in sys.stdin:
    if line == "end\\n":
        ends.release()
    else:
        threading.Thread(target=run, daemon=True).start()
os._exit(0)
"""


class Machine:
    """A machine with four slots, and batches on it that are processes of their own."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._variables = {
            "ROBOMAKER_HOME": str(settings.home),
            "ROBOMAKER_MAX_JOBS": "4",
            "ROBOMAKER_JOB_MEMORY_MB": "0",
            "ROBOMAKER_MIN_FREE_DISK_MB": "0",
        }
        self._files = SlotFiles(settings.home / "slots", 4)
        self._waiters = WaiterFiles(settings.home / "slots" / "waiting")
        self._processes = ExitStack()

    def __enter__(self) -> "Machine":
        return self

    def __exit__(self, *_: object) -> None:
        self._processes.close()

    def batch(self, name: str, priority: int = 0) -> "subprocess.Popen[str]":
        """A batch that wants six slots; returns once it waits for more of them."""
        command = [sys.executable, "-c", _BATCH, name, str(priority)]
        process = self._processes.enter_context(started(command, self._variables, stdin=subprocess.PIPE))
        tell(process, ["begin"] * 6)
        wait_for(lambda: self.free() == 0 and name in self.waiting(), f"{name} to wait")
        return process

    def waiting(self) -> set[str | None]:
        return {record.batch for record in self._waiters.read(time.time()).values()}

    def free(self) -> int:
        return len(self._files.look().free)

    def running(self) -> dict[str | None, int]:
        return dict(self._files.look().by_batch())

    def end(self, batch: "subprocess.Popen[str]", count: int = 1) -> None:
        """Ends jobs of a batch, and waits until as many others have begun."""
        before = self._begun()
        tell(batch, ["end"] * count)
        wait_for(lambda: len(self._begun() - before) == count, f"{count} to begin")

    def _begun(self) -> set[float]:
        """When the jobs that run have begun."""
        return {holder.began_s for holder in self._files.look().holders}

    def check(self, expected: dict[str | None, int]) -> None:
        wait_for(lambda: self.running() == expected, f"{expected}, not {self.running()}")


def tell(process: "subprocess.Popen[str]", words: Iterable[str]) -> None:
    assert process.stdin is not None
    process.stdin.writelines(f"{word}\n" for word in words)
    process.stdin.flush()


def test_two_batches_end_up_with_half_the_slots_each(settings: Settings) -> None:
    with Machine(settings) as machine:
        first = machine.batch("first")
        machine.check({"first": 4})
        second = machine.batch("second")
        machine.end(first)
        machine.check({"first": 3, "second": 1})
        machine.end(first)
        machine.check({"first": 2, "second": 2})
        machine.end(second)
        machine.check({"first": 2, "second": 2})
        machine.end(first)
        machine.check({"first": 2, "second": 2})


@pytest.mark.deep
def test_a_batch_of_higher_priority_gets_the_next_free_slots(settings: Settings) -> None:
    with Machine(settings) as machine:
        first = machine.batch("first")
        urgent = machine.batch("urgent", 1)
        machine.end(first, 3)
        machine.check({"first": 1, "urgent": 3})
        machine.end(urgent)
        machine.check({"first": 1, "urgent": 3})


def test_a_batch_whose_process_is_stopped_or_dies_while_it_waits_blocks_no_other(settings: Settings) -> None:
    with Machine(settings) as machine:
        first = machine.batch("first")
        stopped, dead = machine.batch("stopped", 2), machine.batch("dead", 1)
        stopped.send_signal(signal.SIGSTOP)
        dead.kill()
        machine.end(first, 2)
        machine.check({"first": 4})
        stopped.send_signal(signal.SIGCONT)
        wait_for(lambda: "stopped" in machine.waiting(), "it to wait again")
        machine.end(first)
        machine.check({"first": 3, "stopped": 1})
