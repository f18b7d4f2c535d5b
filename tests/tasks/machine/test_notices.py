"""People are told that jobs wait, and not all the time."""

from prefect_robomaker.tasks.machine.free_memory_and_disk import Wait
from prefect_robomaker.tasks.machine.machine_slots import Notices

SLOTS, MEMORY = Wait("slots", "2 jobs run"), Wait("memory", "none")


def test_a_wait_is_told_once_it_has_lasted_two_seconds_and_again_after_ten_minutes() -> None:
    notices = Notices()

    told = [second for second in range(1300) if notices.is_due(SLOTS, float(second))]

    assert told == [2, 602, 1202]


def test_moments_are_not_told() -> None:
    notices = Notices()

    assert not any(notices.is_due(SLOTS if second % 2 else None, float(second)) for second in range(100))


def test_another_reason_is_told_for_itself() -> None:
    notices = Notices()
    waits = [SLOTS] * 5 + [MEMORY] * 5 + [SLOTS] * 5

    told = [second for second, wait in enumerate(waits) if notices.is_due(wait, float(second))]

    assert told == [2, 7]
