"""Values of a step's axis in pairs: two trials are one only where they differ in nothing else."""

from typing import Any

import pytest
from helpers.night_records import make_job, make_night

from prefect_robomaker.schemas.reports.report import ArmComparison, AxisResult
from prefect_robomaker.schemas.reports.run_record import JobRecord
from prefect_robomaker.tasks.comparison.arms import axis_results, holm_adjusted, joined
from prefect_robomaker.tasks.comparison.compared_runs import CellTable, NightRun
from prefect_robomaker.tasks.results.rates import wilson_interval
from prefect_robomaker.tasks.results.table import ResultTable


def arm(letters: str, robot: str, *, step: str = "drive", limit: float = 5.0, **axes: Any) -> list[JobRecord]:
    """Jobs of one value of the axis `robot`, one a letter, in a world and with a seed of its own each."""
    return [
        make_job(index, letter, world=f"world {index}", seed=index, limit=limit).model_copy(
            update={"label": f"sim-{robot}-{index}-{step}-{axes}", "step": step, "axes": {"robot": robot, **axes}}
        )
        for index, letter in enumerate(letters)
    ]


def results_of(
    jobs: list[JobRecord], digests: dict[str, str] | None = None, *, between_worlds: bool = False
) -> list[AxisResult]:
    run = NightRun.of(make_night(jobs))
    table = ResultTable.of(jobs)
    night = NightRun(run.run_id, run.name, run.started_at, run.state, jobs, table=table)
    return axis_results(night, digests or {}, between_worlds=between_worlds)


def compared(jobs: list[JobRecord], digests: dict[str, str] | None = None) -> list[ArmComparison]:
    return [each for result in results_of(jobs, digests) if result.axis == "robot" for each in result.comparisons]


def test_a_robot_that_passes_more_often_in_pairs_is_better() -> None:
    [found] = compared([*arm("FFFFFFFFPP", "scout"), *arm("PPPPPPPPPP", "rover")])

    assert (found.baseline, found.value, found.answer, found.pairs) == ("scout", "rover", "better", 10)
    assert found.rate is not None
    assert (found.rate.before, found.rate.after) == (0.2, 1.0)
    assert found.adjusted_p_value == pytest.approx(2 * 0.5**8)
    assert found.why == "10 pairs judged, p = 0.0078 (exact McNemar test, Holm's method)"
    [result] = results_of([*arm("FP", "scout"), *arm("PP", "rover")])
    assert [(share.name, share.passed, share.failed) for share in result.shares] == [("scout", 1, 1), ("rover", 2, 0)]


@pytest.mark.parametrize("other", ["seed", "axis", "step"])
def test_jobs_that_differ_in_more_than_the_axis_are_no_pair(other: str) -> None:
    first, second = arm("PPPP", "scout", speed=1.0), arm("FFFF", "rover", speed=2.0 if other == "axis" else 1.0)
    for place, job in enumerate(second):
        assert job.inputs is not None
        change = {"seed": {"seed": 100 + place}}.get(other, {})
        inputs = job.inputs.model_copy(update=change)
        second[place] = job.model_copy(update={"inputs": inputs, "step": "again" if other == "step" else "drive"})

    robots = [each for each in results_of([*first, *second]) if each.axis == "robot"]

    assert [each.comparisons for each in robots] == [[]] * len(robots)
    assert all(each.note for each in robots)


def moved(jobs: list[JobRecord], worlds: list[str]) -> list[JobRecord]:
    """The jobs in other worlds."""
    return [
        job.model_copy(update={"inputs": job.inputs.model_copy(update={"world": world}), "world": f"flat {world}"})
        for job, world in zip(jobs, worlds, strict=True)
        if job.inputs
    ]


def test_an_axis_that_varies_the_world_has_pairs_by_what_else_they_share() -> None:
    """Doors of eight flats, open and half shut: with the flats as an axis, the base world goes with it."""
    flats = [str(number) for number in range(8)]
    doors = {"open": "PPPPPPPP", "half shut": "FFFFFFFF"}
    jobs = [
        job
        for door, letters in doors.items()
        for flat, letter in zip(flats, letters, strict=True)
        for job in moved(arm(letter, door, flat=flat), [f"flat {flat}, door {door}"])
    ]

    [found] = compared(jobs)

    assert (found.answer, found.pairs, found.of_two_worlds) == ("worse", 8, 8)
    assert found.rate is not None
    assert found.rate.worlds == 8
    assert "the sides of 8 pairs drove in different worlds" in found.why


def test_pairs_that_share_a_world_are_no_sample_of_worlds() -> None:
    """Two worlds with eight seeds each tell of these two only."""
    jobs = [*moved(arm("PPPPPPPP", "open"), ["a"] * 8), *moved(arm("FFFFFFFF", "half shut"), ["b"] * 8)]

    [found] = compared(jobs)

    assert found.rate is not None
    assert (found.answer, found.pairs, found.rate.worlds) == ("worse", 8, 1)
    assert "in these worlds; others were not tried" in found.why
    # Clusters grow together through a world that they share.
    assert joined([("a", "b"), ("c", "d"), ("b", "c"), ("e", "f")]) == [0, 0, 0, 1]


def test_comparisons_of_worlds_make_those_of_robots_no_weaker() -> None:
    """An axis of worlds beside that of robots; six worlds are a sample, and are not compared."""
    for count, asked in ((3, 2), (6, 0)):
        worlds = [f"w{number}" for number in range(count)]
        jobs = [
            job
            for robot, letters in {"scout": "FFFFFFPP", "rover": "PPPPPPPP"}.items()
            for world in worlds
            for job in moved(arm(letters, robot, place=world), [world] * 8)
        ]
        found = {each.axis: each for each in results_of(jobs)}
        [robots] = found["robot"].comparisons
        assert robots.rate is not None
        assert robots.adjusted_p_value == robots.rate.p_value
        assert found["place"].comparisons == [], "nobody asked for them"
        [place] = [each for each in results_of(jobs, between_worlds=True) if each.axis == "place"]
        assert [each.value for each in place.comparisons] == ["flat w1", "flat w2"][:asked]
        notes = {3: "its 3 values are worlds, which are compared on request only"}
        notes[6] = "its 6 values are worlds, too many to be compared each with the first one"
        assert found["place"].note == notes[count]


def test_jobs_of_one_cell_in_several_worlds_have_no_partner_in_another_one() -> None:
    """Tags that were written by hand, so that the world is not that of the cell: any partner would be a guess."""
    first, second = arm("PP", "scout"), arm("FF", "rover")
    jobs = [
        job.model_copy(update={"inputs": job.inputs.model_copy(update={"seed": 1, "world": f"{job.label}"})})
        for job in (*first, *second)
        if job.inputs
    ]
    assert compared(jobs) == []


def test_jobs_of_one_cell_are_kept_apart() -> None:
    """A step that lists a job twice: the second one must not take the place of the first, and of its failure."""
    first, again = arm("FP", "scout"), arm("PP", "scout")
    again = [job.model_copy(update={"label": f"{job.label} again"}) for job in again]
    twice = [job.model_copy(update={"label": f"{job.label} again"}) for job in arm("PF", "rover")]

    [found] = compared([*first, *again, *arm("PP", "rover"), *twice])
    assert found.rate is not None
    assert (found.pairs, found.unpaired, found.rate.before, found.rate.after) == (4, 0, 0.75, 0.75)

    [found] = compared([*first, *again, *arm("PP", "rover")])
    assert (found.pairs, found.unpaired) == (2, 2)
    assert found.rate is not None
    assert (found.rate.before, found.rate.after) == (0.5, 1.0), "the partners are the first ones"
    assert "2 trials without a partner" in found.why


def test_values_that_look_alike_have_a_row_each_and_what_has_none_is_said() -> None:
    jobs = [*arm("P", "scout", speed=1.0), *arm("F", "scout", speed="1")]
    [speed] = [each for each in results_of(jobs) if each.axis == "speed"]
    assert [(share.name, share.passed, share.failed) for share in speed.shares] == [("1", 1, 0), ("1", 0, 1)]

    [robots] = results_of([job for number in range(53) for job in arm("P", f"robot {number}")])
    assert len(robots.shares) == 50
    assert robots.note == "3 more values have no row; 32 more values are not compared"


def test_what_has_no_partner_is_counted_and_said() -> None:
    [found] = compared([*arm("PPPP", "scout"), *arm("PP", "rover")])

    assert (found.pairs, found.unpaired) == (2, 2)
    assert "2 trials without a partner" in found.why


def test_pairs_with_other_requirements_do_not_count() -> None:
    [found] = compared([*arm("PPPPPPPP", "scout"), *arm("FFFFFFFF", "rover", limit=1.0)])

    assert (found.answer, found.other_requirements, found.rate) == ("not comparable", 8, None)
    assert "judged by different requirements" in found.why


def test_what_broke_is_neither_passed_nor_left_out_silently() -> None:
    [found] = compared([*arm("FFFFFFFFPPPPPPPP", "scout"), *arm("PPPPPPPPEEEEEEEE", "rover")])

    assert (found.answer, found.unjudged) == ("not comparable", 8)
    assert "depends on 8 pairs of which a side broke" in found.why


def test_many_values_share_the_error_of_one() -> None:
    jobs = [*arm("FFFFFFPP", "a"), *arm("PPPPPPPP", "b")]
    assert [each.answer for each in compared(jobs)] == ["better"]  # p = 0.031

    more = [*jobs, *arm("FFFFFFPP", "c"), *arm("FFFFFFPP", "d")]
    assert [(each.value, each.answer) for each in compared(more)] == [
        ("b", "no difference shown"), ("c", "no difference shown"), ("d", "no difference shown"),
    ]  # fmt: skip
    assert holm_adjusted([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm_adjusted([]) == []


@pytest.mark.parametrize(
    ("margins", "result", "told"),
    [
        ("PPPPPP FFFFFF", "too few pairs to tell", "6 of 6 that differ went the same way; 1 more pair would show it"),
        ("PPPPPP PPPFPP", "too few pairs to tell", "1 of 1 that differ went the same way; 59 more pairs would show it"),
        (f"{'P' * 60} {'P' * 60}", "no difference shown", ""),
    ],
)
def test_pairs_that_are_too_few_for_an_answer_are_not_called_the_same(margins: str, result: str, told: str) -> None:
    """All pairs that differ may go one way, and still be too few beside those of another axis (Holm)."""
    near, far = margins.split()
    jobs = [
        job
        for value, letters in (("0.28", near), ("0.19", far))
        for first, speed in enumerate(("slow", "fast"))
        for job in arm(letters[first::2], "scout", margin=value, speed=speed)
    ]
    [margin] = [each for axis in results_of(jobs) if axis.axis == "margin" for each in axis.comparisons]
    assert (margin.answer, margin.result) == ("no difference shown", result)
    assert told in margin.why
    assert ("more pair" in margin.why) == bool(told)


def test_an_axis_that_changes_nothing_is_told() -> None:
    jobs = [*arm("PP", "scout"), *arm("PP", "rover")]
    digests = {job.label: f"states of {job.inputs and job.inputs.seed}" for job in jobs}

    [same] = compared(jobs, digests)
    [unknown] = compared(jobs)
    [differ] = compared(jobs, {**digests, jobs[0].label: "others"})

    assert same.same_states
    assert "went through the same states: the axis changes nothing" in same.why
    assert not unknown.same_states
    assert not differ.same_states


def test_jobs_of_two_nights_are_matched_by_their_cells() -> None:
    table = CellTable()
    first = table.place([*arm("P", "scout"), *arm("P", "rover")])
    # The next night has one more robot, in front, and another request for all of them.
    jobs = [*arm("P", "walker"), *arm("P", "scout"), *arm("P", "rover")]
    changed = [
        job.model_copy(update={"inputs": job.inputs.model_copy(update={"request_sha256": "new"})})
        for job in jobs
        if job.inputs
    ]

    assert table.place(changed)[1:] == first


def test_pairs_that_repeat_others_are_no_more_evidence() -> None:
    """An axis beside this one that changes nothing would double the pairs, as often as one likes."""
    robots = {"scout": "PPPP", "rover": "FFFF"}
    jobs = [each for unread in "abc" for robot in robots for each in arm(robots[robot], robot, unread=unread)]
    digests = {job.label: f"{job.axes['robot']} {job.inputs and job.inputs.seed}" for job in jobs}

    [once] = compared(jobs, digests)
    [unknown] = compared(jobs)

    assert once.rate is not None
    assert unknown.rate is not None
    assert (once.pairs, once.repeated, once.rate.pairs, once.answer) == (12, 8, 4, "no difference shown")
    assert "8 pairs repeat another pair state by state and do not count" in once.why
    assert (unknown.rate.pairs, unknown.answer) == (12, "worse")


def test_copies_do_not_narrow_the_interval_of_a_value() -> None:
    jobs = [job.model_copy(update={"state_digest": "same"}) for job in moved(arm("PPP", "scout"), ["w"] * 3)]

    [result] = results_of(jobs)

    [share] = result.shares
    assert (share.passed, share.copies) == (3, 2)
    assert (share.low, share.high) == wilson_interval(1, 1)
