from collections.abc import Sequence
from itertools import pairwise

import pytest
from helpers.scripted_wire import ScriptedWire
from helpers.stop_flags import StopFlag
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.ros_options import RosOptions
from prefect_robomaker.tasks.runtime.episode.progress import RunStopped
from prefect_robomaker.tasks.runtime.ros.simulated_time import Lockstep, TimerNodeError, make_timing
from prefect_robomaker.tasks.runtime.ros.wire import STILL, Command

STEP_S = 0.05


def drive(speed: float, stamp_s: float | None = None) -> Command:
    return Command((speed, 0.0, 0.0), STILL, stamp_s)


def steps(wire: ScriptedWire, options: RosOptions, count: int, scan_every: int = 4) -> list[tuple[float, float | None]]:
    """The wall-clock time after each step, and the speed that was commanded in it."""
    timing = make_timing(wire, StopFlag(), options, STEP_S, wire.clock)
    found = []
    for number in range(count):
        if isinstance(timing, Lockstep):
            timing.forget()
        wire.send("/clock", b"")
        command = timing.next_command(number * STEP_S, scanned=number % scan_every == 0)
        found.append((round(wire.now_s, 3), command.linear_mps[0] if command else None))
    return found


@pytest.mark.parametrize(("factor", "took_s"), [(1.0, 2.0), (10.0, 0.2)])
def test_free_time_passes_as_fast_as_asked(factor: float, took_s: float) -> None:
    wire = ScriptedWire([(0.07, drive(0.3)), (0.08, drive(0.4))])
    found = steps(wire, RosOptions(time="free", real_time_factor=factor), 40)
    assert found[-1][0] == pytest.approx(took_s)
    taken = [speed for _, speed in found if speed is not None]
    assert taken == ([0.4] if factor == 1.0 else [0.3, 0.4])  # of one step the newest


def test_paced_time_waits_for_nodes_that_are_slow() -> None:
    # A controller that is asked for 10 commands in a second and manages one in 0.6 s.
    slow = ScriptedWire([(0.6 * number, drive(0.1)) for number in range(1, 20)])
    found = steps(slow, RosOptions(ahead_s=0.25), 60)
    commanded = [number for number, (_, speed) in enumerate(found) if speed is not None]
    gaps = [later - earlier for earlier, later in pairwise(commanded)]
    assert max(gaps) <= 5  # 0.25 s simulated
    quick = ScriptedWire([(0.05 * number, drive(0.1)) for number in range(1, 100)])
    assert steps(quick, RosOptions(ahead_s=0.25), 60)[-1][0] == pytest.approx(3.0)


def test_paced_time_goes_on_for_nodes_that_have_nothing_to_say() -> None:
    wire = ScriptedWire([(0.1, drive(0.1))])
    found = steps(wire, RosOptions(), 100)
    assert found[-1][0] == pytest.approx(100 * STEP_S + 1.0, abs=0.06)  # one silence of a second


def test_lockstep_waits_for_the_answer_to_each_scan() -> None:
    def answer(topic: str, now_s: float) -> Sequence[tuple[float, Command]]:
        return [(now_s + 0.3, drive(0.2))] if topic == "/clock" else []

    wire = ScriptedWire(answer=answer)
    found = steps(wire, RosOptions(time="lockstep"), 12)
    assert [speed for _, speed in found] == [0.2, None, None, None] * 3
    assert found[-1][0] == pytest.approx(0.9)
    each = steps(ScriptedWire(answer=answer), RosOptions(time="lockstep", answers="step"), 12)
    assert [speed for _, speed in each] == [0.2] * 12


def test_lockstep_takes_no_command_that_is_older_than_the_step() -> None:
    def answer(topic: str, now_s: float) -> Sequence[tuple[float, Command]]:
        number = len(wire.sent) - 1
        return [(now_s + 0.1, drive(9.0, stamp_s=number * STEP_S - 0.13)), (now_s + 0.2, drive(0.1, number * STEP_S))]

    wire = ScriptedWire(answer=answer)
    found = steps(wire, RosOptions(time="lockstep", answers="step"), 5)
    assert [speed for _, speed in found] == [9.0, *[0.1] * 4]  # before the first step there is nothing older


@pytest.mark.parametrize("behind", [0.0, 0.9 * STEP_S])
def test_lockstep_takes_answers_without_a_stamp_and_of_a_clock_that_is_behind(behind: float) -> None:
    def answer(topic: str, now_s: float) -> Sequence[tuple[float, Command]]:
        stamp_s = (len(wire.sent) - 1) * STEP_S - behind if behind else 0.0
        return [(now_s + 0.1, drive(0.1, stamp_s=stamp_s))]

    wire = ScriptedWire(answer=answer)
    found = steps(wire, RosOptions(time="lockstep", answers="step"), 5)
    assert [speed for _, speed in found] == [0.1] * 5


def test_lockstep_names_nodes_that_send_by_a_timer() -> None:
    # A timer of 0.1 s of simulated time: every second step of 0.05 s has a command.
    def answer(topic: str, now_s: float) -> Sequence[tuple[float, Command]]:
        return [(now_s + 0.001, drive(0.2))] if len(wire.sent) % 2 else []

    wire = ScriptedWire(answer=answer)
    with pytest.raises(TimerNodeError, match=r"8 of the last 16 steps .*within 5 s\. .*timer.*\"time\": \"paced\""):
        steps(wire, RosOptions(time="lockstep", answers="step"), 100)


@given(st.lists(st.floats(0.0, 20.0), max_size=40), st.sampled_from(["paced", "free"]))
def test_time_always_goes_on_and_never_faster_than_asked(arrivals: list[float], mode: str) -> None:
    wire = ScriptedWire([(at_s, drive(0.1)) for at_s in arrivals])
    options = RosOptions.model_validate({"time": mode})
    found = steps(wire, options, 50)
    assert found[-1][0] >= 50 * STEP_S - 1e-6
    # Each command can end one wait, each wait is a second at most.
    assert found[-1][0] <= 50 * STEP_S + (len(arrivals) + 1) * 1.0 + 1e-6


@pytest.mark.parametrize("mode", ["paced", "free", "lockstep"])
def test_a_run_that_is_stopped_waits_no_longer(mode: str) -> None:
    wire, stop = ScriptedWire(), StopFlag("canceled")
    timing = make_timing(wire, stop, RosOptions.model_validate({"time": mode}), STEP_S, wire.clock)
    with pytest.raises(RunStopped):
        timing.next_command(0.0, scanned=True)
    assert wire.now_s < 0.1
