"""Jobs side by side: changed verdicts come first, and nothing that is not the same is called better or worse."""

from typing import Any

import pytest
from helpers.night_records import make_job
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.run_record import JobRecord
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.comparison.pairing import Pair
from prefect_robomaker.tasks.comparison.side_by_side import (
    axes_of,
    by_change,
    has_changed,
    pair_cells,
    requirements_beside,
    was_run,
)

LETTERS = st.sampled_from("PFECN")


def item(satisfied: bool = True, **members: Any) -> Requirement:
    given = {"name": "gentle", "kind": "no_collision", "unit": "N", "limit": 5.0, "detail": "", **members}
    return Requirement(satisfied=satisfied, **given)


def pair_of(before: Requirement | None, after: Requirement | None, letters: str = "PP", limit: float = 5.0) -> Pair:
    jobs = [make_job(0, letters[0]), make_job(0, letters[1], night=1, limit=limit)]
    found = [
        job.model_copy(update={"requirements": [each] if each else []})
        for job, each in zip(jobs, (before, after), strict=True)
    ]
    return Pair(*found)


@pytest.mark.parametrize(
    ("before", "after", "letters", "turn", "why"),
    [
        (item(margin=2.0), item(False, margin=-1.0), "PF", "worse", "newly missed"),
        (item(False), item(), "FP", "better", "newly met"),
        (item(margin=2.0), item(margin=3.5), "PP", "better", "margin +1.5 N"),
        (item(False, margin=-1.0), item(False, margin=-2.0), "FF", "worse", "still missed, margin -1 N"),
        (item(margin=2.0), item(margin=2.00001), "PP", "unchanged", ""),
        (item(), item(), "PP", "unchanged", ""),
        (item(margin=2.0), item(margin=1.0, unit="m"), "PP", "not comparable", "margins in N and in m"),
        (item(margin=1.0, kind="predicate"), item(margin=0.5, kind="predicate"), "PP", "unchanged", ""),
        (item(), item(False, error="no such body"), "PP", "not comparable", "it broke in B"),
        (item(), None, "PE", "not comparable", "B broke"),
        (None, item(), "CP", "not comparable", "A was not run"),
        (item(), None, "PP", "not comparable", "it is not asked of B"),
        (None, item(False, kind="health"), "PF", "worse", "newly missed"),
        (item(False, kind="health"), None, "FP", "better", "no longer missed"),
        (None, item(False, kind="health"), "EF", "not comparable", "A broke"),
    ],
)
def test_a_requirement_is_better_or_worse_only_where_both_were_judged(
    before: Requirement | None, after: Requirement | None, letters: str, turn: str, why: str
) -> None:
    [row] = requirements_beside(pair_of(before, after, letters))
    assert (row.turn, row.why) == (turn, why)


OFF = {"kind": "off", "counts": False, "margin": None, "limit": None}


@pytest.mark.parametrize(
    ("before", "after", "turn", "why"),
    [
        (item(False, **OFF), item(False, **OFF), "unchanged", "it does not count"),
        (item(False, **OFF), item(**OFF), "unchanged", "it does not count"),
        (item(False, **OFF), item(), "not comparable", "it does not count in A"),
        (
            item(counts=False),
            item(False),
            "not comparable",
            "it does not count in A",
        ),  # it ended with its goals reached
        (item(False), item(counts=False), "not comparable", "it does not count in B"),
        (item(), item(False, counts=False), "not comparable", "it does not count in B"),
        (item(False, **OFF), None, "unchanged", "it does not count"),
    ],
)
@pytest.mark.parametrize("of_trials", [False, True])
def test_what_is_off_is_neither_better_nor_worse_and_comes_last(
    before: Requirement, after: Requirement | None, turn: str, why: str, of_trials: bool
) -> None:
    told = Requirement(name="trials", satisfied=False, detail="4 of 8 trials did not pass")
    soft = item(name="soft", counts=not of_trials)
    pair = Pair(
        *(
            each.model_copy(update={"requirements": [first, soft, *([told] if of_trials else [])]})
            if first
            else each.model_copy(update={"requirements": [soft]})
            for each, first in zip((make_job(0, "F"), make_job(0, "F", night=1)), (before, after), strict=True)
        )
    )
    rows = requirements_beside(pair)
    if of_trials and (before.kind, after and after.kind) == ("no_collision", "no_collision"):
        assert rows[0].name == "gentle", "of trials no single requirement counts in the job"
        return
    [row] = [each for each in rows if each.name == "gentle"]
    assert (row.turn, row.why) == (turn, why)
    if turn == "unchanged":
        assert rows[-1].name == "gentle"


@pytest.mark.parametrize(
    ("before", "after", "turn", "why"),
    [
        ("met in 4 of 8 trials", "met in 8 of 8 trials", "better", "met in 4 more trials"),
        ("met in 5 of 8 trials", "met in 4 of 8 trials", "worse", "met in 1 fewer trial"),
        ("met in 4 of 8 trials", "met in 4 of 8 trials", "unchanged", ""),
        ("met in 4 of 8 trials", "met in 4 of 4 trials", "not comparable", "8 trials in A, 4 in B"),
    ],
)
def test_trials_are_counted_and_their_smallest_margin_tells_nothing(
    before: str, after: str, turn: str, why: str
) -> None:
    own = Requirement(name="trials", satisfied=False, detail="4 of 8 trials did not pass")
    sides = [
        make_job(0, "F").model_copy(
            update={"requirements": [own, item(False, margin=margin, detail=detail, counts=False)]}
        )
        for margin, detail in ((-15.5, before), (-1.0, after))
    ]
    row = requirements_beside(Pair(*sides))[1]
    assert (row.turn, row.why) == (turn, why)


@pytest.mark.parametrize(
    ("before", "after", "turn", "why"),
    [
        ("8 of 16 trials did not pass: 0", "16 of 16 trials did not pass: 0", "worse", "failed in 8 more trials"),
        ("1 of 1 trial did not pass: 0", "none of 1 trial failed", "better", "failed in 1 fewer trial"),
        ("8 of 16 trials did not pass: 0", "8 of 16 trials did not pass: 3", "unchanged", ""),
        ("8 of 16 trials did not pass: 0", "8 of 8 trials did not pass: 0", "not comparable", "16 trials in A, 8 in B"),
    ],
)  # fmt: skip
def test_trials_that_newly_fail_are_counted_and_their_jobs_come_first(
    before: str, after: str, turn: str, why: str
) -> None:
    found = [Requirement(name="trials", satisfied="none" in detail, detail=detail) for detail in (before, after)]
    jobs = [make_job(0, "F").model_copy(update={"requirements": [each]}) for each in found]
    pair, same = Pair(*jobs), Pair(jobs[0], jobs[0])
    [row] = requirements_beside(pair)
    assert (row.turn, row.why) == (turn, why)
    if turn != "unchanged":
        assert by_change([same, pair])[0] is pair


def test_a_requirement_that_asks_for_something_else_is_not_comparable() -> None:
    eased = pair_of(item(False, margin=-1.0), item(margin=2.0, limit=8.0), "FP", limit=8.0)
    other_place = pair_of(item(False, limit=None), item(limit=None), "FP", limit=8.0)
    asked = {"gentle": {"kind": "goal", "x": 1}}, {"gentle": {"kind": "goal", "x": 2}}

    assert [row.turn for row in requirements_beside(eased)] == ["not comparable"]
    assert [row.turn for row in requirements_beside(other_place, asked)] == ["not comparable"]
    assert [row.turn for row in requirements_beside(other_place, (asked[0], asked[0]))] == ["better"]


@given(st.lists(st.tuples(LETTERS, LETTERS), max_size=12))
def test_no_pair_is_lost_and_those_that_changed_come_first(letters: list[tuple[str, str]]) -> None:
    pairs = [
        Pair(make_job(index, old), make_job(index, new, night=1)) for index, (old, new) in enumerate(letters)
    ]  # fmt: skip
    found = by_change(pairs)

    assert sorted(pair.after.label for pair in found) == sorted(pair.after.label for pair in pairs)
    changed = [has_changed(pair) for pair in found]
    assert changed == sorted(changed, reverse=True)
    run = ["C" not in pair for pair in letters]
    assert [was_run(pair) for pair in found] == sorted(run, reverse=True), "those that were not run are last"


def cell(robot: Any, seed: int, label: str, **axes: Any) -> JobRecord:
    job = make_job(seed, "P", world="flat", seed=seed)
    return job.model_copy(update={"label": label, "axes": {"robot": robot, **axes}})


@given(
    st.lists(st.tuples(st.sampled_from(("scout", "rover", "husky")), st.integers(0, 3), st.sampled_from((1.0, 2.0))))
)
def test_cells_differ_in_one_axis_only_and_no_job_is_in_two_pairs(cells: list[tuple[str, int, float]]) -> None:
    jobs = [cell(robot, seed, f"sim-{place}", gain=gain) for place, (robot, seed, gain) in enumerate(cells)]
    axis = next((each for each in axes_of(jobs) if each.name == "robot"), None)
    if axis is None:
        return
    found = pair_cells(jobs, axis, axis.values[0], axis.values[1])
    here = [job.label for job in jobs if job.axes["robot"] in axis.values[:2]]
    told = [job.label for pair in found.pairs for job in (pair.before, pair.after)]
    told += [job.label for job in (*found.only_before, *found.only_after)]

    assert sorted(told) == sorted(here)
    for pair in found.pairs:
        assert pair.before.axes["gain"] == pair.after.axes["gain"]
        assert pair.before.inputs is not None
        assert pair.after.inputs is not None
        assert pair.before.inputs.seed == pair.after.inputs.seed


def test_values_that_look_alike_are_two() -> None:
    [axis] = axes_of([cell("1", 0, "sim-text"), cell(1.0, 0, "sim-number")])
    [pair] = pair_cells([cell("1", 0, "sim-text"), cell(1.0, 0, "sim-number")], axis, *axis.values).pairs
    assert (pair.before.label, pair.after.label) == ("sim-text", "sim-number")
    assert axis.titles == ("1", "1")


def test_cells_of_an_axis_that_varies_the_world_are_paired_by_what_else_they_share() -> None:
    """As the results of axes pair them: doors of three flats, open and half shut."""

    def moved(door: str, flat: int, world: str, label: str) -> JobRecord:
        job = make_job(flat, "P", world=world, seed=1)
        return job.model_copy(update={"label": label, "axes": {"doors": door, "flat": float(flat)}})

    jobs = [moved(door, flat, f"{flat} {door}", f"{door} {flat}") for door in ("open", "shut") for flat in range(3)]
    doors = next(axis for axis in axes_of(jobs) if axis.name == "doors")
    found = pair_cells(jobs, doors, *doors.values)
    assert [(pair.before.label, pair.after.label) for pair in found.pairs] == [
        (f"open {flat}", f"shut {flat}") for flat in range(3)
    ]
    # Of two worlds in one place nothing says which one is the partner.
    found = pair_cells([*jobs, moved("shut", 0, "elsewhere", "shut, too")], doors, *doors.values)
    assert [pair.before.label for pair in found.pairs] == ["open 1", "open 2"]
    assert [job.label for job in found.only_before] == ["open 0"]
    assert [job.label for job in found.only_after] == ["shut 0", "shut, too"]
