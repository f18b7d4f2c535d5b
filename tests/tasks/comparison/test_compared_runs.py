"""Cells: which job of one run is which of another."""

from helpers.night_records import make_job
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.comparison.compared_runs import CellTable, name_of, reason_of


def test_jobs_are_told_apart_by_step_world_and_given_seed() -> None:
    table = CellTable()
    first = [make_job(0, "P"), make_job(1, "P"), make_job(1, "P", seed=8)]
    assert table.place(first) == [0, 1, 2]
    # Another night: other ids and names of worlds, another order, one job less.
    assert table.place([make_job(1, "F", night=1, seed=8), make_job(0, "F", night=1)]) == [2, 0]
    other_step = make_job(0, "P").model_copy(update={"step": "again"})
    assert table.place([other_step, make_job(0, "P", world="another")]) == [3, 4]


def test_a_seed_by_chance_is_another_every_night_and_does_not_part_jobs() -> None:
    table = CellTable()
    assert table.place([make_job(0, "P", seed=None), make_job(1, "P", seed=None)]) == [0, 1]
    assert table.place([make_job(1, "P", seed=None, night=1), make_job(0, "F", seed=None, night=1)]) == [1, 0]


def test_jobs_without_a_world_are_found_by_request_then_by_order() -> None:
    table = CellTable()

    def order(*requests: str) -> list[int | None]:
        return table.place([make_job(i, "P", world=None, request=each) for i, each in enumerate(requests)])

    assert order("a", "b", "c") == [0, 1, 2]
    # A rerun of some, one put in front, and one that was rewritten.
    assert order("c") == [2]
    assert order("new", "a", "b", "c") == [3, 0, 1, 2]
    assert order("new", "a", "changed", "c") == [3, 0, 1, 2]
    assert order("new", "a", "changed", "c") == [3, 0, 1, 2]


def test_jobs_of_early_records_have_no_cell() -> None:
    assert CellTable().place([make_job(0, "P").model_copy(update={"inputs": None})]) == [None]


@given(st.permutations(range(8)), st.sets(st.integers(0, 7)))
def test_no_two_jobs_of_a_run_share_a_cell(order: list[int], missing: set[int]) -> None:
    table = CellTable()
    jobs = [make_job(index, "P", world=f"world {index % 3}", request=f"request {index % 2}") for index in range(8)]
    table.place(jobs)
    places = table.place([jobs[index] for index in order if index not in missing])
    assert len(set(places)) == len(places)
    assert len(table) == 8


def test_names_and_reasons() -> None:
    assert name_of(make_job(2, "F")).title == "drive: world-3 scout, seed 7"
    assert name_of(make_job(2, "F", seed=None)).title == "drive: world-3 scout"
    assert reason_of(make_job(0, "P")) == ""
    assert reason_of(make_job(0, "F")) == "gentle: 9 N, at most 5 N asked"
    assert reason_of(make_job(0, "E")) == "RobotApplicationCrash: ZeroDivisionError"
