"""Waits are added up by what was waited for."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.programs import Scarce, noticed
from prefect_robomaker.tasks.machine.machine_slots import WaitTimes

SEEN = st.lists(st.tuples(st.sampled_from(["slots", "memory", "disk", None]), st.floats(0.0, 100.0)), min_size=1)


def test_each_wait_lasts_until_something_else_is_seen() -> None:
    times = WaitTimes()
    seen: list[Scarce | None] = [None, "memory", "memory", "disk", None, None, "memory", None]

    for second, scarce in enumerate(seen):
        times.see(scarce, float(second))

    assert times.total_s({}) == {"memory": 3.0, "disk": 1.0}
    assert times.total_s({"memory": 2.5}) == {"memory": 0.5, "disk": 1.0}


@given(seen=SEEN)
def test_no_second_counts_twice(seen: list[tuple[Scarce | None, float]]) -> None:
    times, now_s = WaitTimes(), 1000.0
    for scarce, pause_s in seen:
        now_s += pause_s
        times.see(scarce, now_s)
    times.see(None, now_s)

    waited = sum(pause_s for (scarce, _), (_, pause_s) in pairwise(seen) if scarce)
    assert abs(sum(times.total_s({}).values()) - waited) < 1e-6


def test_a_clock_that_is_set_back_takes_nothing_away() -> None:
    times = WaitTimes()
    for now_s in (100.0, 103.0, 50.0, 51.0):
        times.see("disk", now_s)

    assert times.total_s({}) == {"disk": 4.0}


def test_only_waits_of_a_second_and_more_are_recorded() -> None:
    assert noticed({"memory": 12.345, "slots": 0.99, "disk": 1.0}) == {"memory": 12.3, "disk": 1.0}
