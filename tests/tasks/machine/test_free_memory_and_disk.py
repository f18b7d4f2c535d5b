"""Whether a machine has room for another job: memory, unless it would be alone, and disk."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.machine.free_memory_and_disk import Need, Room, why_wait

MB = 10**6
NEED = Need(memory_bytes=500 * MB, disk_bytes=200 * MB)
ROOM = Room(memory_bytes=2000 * MB, disk_bytes=1000 * MB, running=2, growing=0)
ROOMS = st.builds(
    Room,
    st.none() | st.integers(0, 4000 * MB),
    st.integers(0, 400 * MB),
    running=st.integers(0, 8),
    growing=st.integers(0, 8),
)


def test_there_is_room_on_a_healthy_machine() -> None:
    assert why_wait(NEED, ROOM) is None


def test_memory_that_is_not_available_is_waited_for() -> None:
    wait = why_wait(NEED, replace(ROOM, memory_bytes=499 * MB))

    assert wait is not None
    assert wait.scarce == "memory"
    assert wait.text == (
        "499 MB of memory are available; another job begins with at least 500 MB (ROBOMAKER_JOB_MEMORY_MB)"
    )


def test_jobs_that_have_just_begun_keep_their_memory() -> None:
    assert why_wait(NEED, replace(ROOM, growing=3)) is None
    wait = why_wait(NEED, replace(ROOM, memory_bytes=1999 * MB, growing=3))

    assert wait is not None
    assert "of which jobs that have just begun may take 1500 MB;" in wait.text


def test_a_job_that_would_be_alone_waits_for_no_memory_but_for_a_disk_that_is_all_but_full() -> None:
    alone = replace(ROOM, memory_bytes=0, running=0)

    assert why_wait(NEED, alone) is None
    wait = why_wait(NEED, replace(alone, disk_bytes=199 * MB))
    assert wait is not None
    assert wait.scarce == "disk"
    assert wait.text == (
        "199 MB are free on the disk of ROBOMAKER_HOME, and a job begins with at least 200 MB "
        "(ROBOMAKER_MIN_FREE_DISK_MB)"
    )


def test_memory_that_nothing_tells_of_is_not_waited_for() -> None:
    assert why_wait(NEED, replace(ROOM, memory_bytes=None)) is None


@given(ROOMS, st.integers(0, 1000 * MB))
def test_more_room_never_makes_a_job_wait(room: Room, more: int) -> None:
    if why_wait(NEED, room) is None:
        memory = None if room.memory_bytes is None else room.memory_bytes + more
        assert why_wait(NEED, replace(room, memory_bytes=memory, disk_bytes=room.disk_bytes + more)) is None


@given(ROOMS)
def test_who_needs_nothing_waits_only_for_jobs_that_grow(room: Room) -> None:
    assert why_wait(Need(0, 0), room) is None
