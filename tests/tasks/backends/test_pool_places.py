"""How many job workers a work pool is to have: places, and pauses after early ends."""

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.backends.pool_runs import Places


def test_each_machine_gets_one() -> None:
    assert Places().missing(0, 3, 0.0) == 3
    assert Places().missing(2, 3, 0.0) == 1
    assert Places().missing(3, 3, 0.0) == 0


def test_those_that_are_too_many_are_said() -> None:
    assert Places().missing(5, 2, 0.0) == -3


def test_a_place_stays_empty_for_a_while_that_grows_and_has_an_end() -> None:
    places, now, pauses = Places(), 0.0, []
    for _ in range(7):
        places.note_end(0.5, now)
        began = now
        while places.missing(0, 1, now) == 0:
            now += 0.5
        pauses.append(now - began)

    assert pauses == [5, 10, 20, 40, 60, 60, 60]


def test_a_long_life_begins_the_pauses_anew() -> None:
    places = Places()
    for now in (0.0, 100.0, 200.0):
        places.note_end(0.5, now)
    places.note_end(90.0, 300.0)

    assert places.missing(0, 1, 304.0) == 0
    assert places.missing(0, 1, 305.0) == 1


def test_a_machine_that_comes_does_not_wait_for_the_pause_of_another() -> None:
    places = Places()
    places.note_end(0.5, 0.0)

    assert places.missing(0, 1, 1.0) == 0
    assert places.missing(0, 2, 1.0) == 1


@given(
    st.lists(st.floats(0, 200), max_size=20), st.integers(0, 20), st.integers(0, 20), st.floats(0, 100)
)  # fmt: skip
def test_never_more_than_there_is_room(lives: list[float], alive: int, room: int, now: float) -> None:
    places = Places()
    for lived_s in lives:
        places.note_end(lived_s, now)

    assert alive + places.missing(alive, room, now) <= room
    assert places.missing(0, room, now + 60.0) == room, "no place is lost for good"
