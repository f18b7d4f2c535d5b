"""Comparing two runs: the four answers and what they rest on."""

from pathlib import Path
from typing import Any, Literal

import pytest
from helpers.night_records import make_job, make_night, make_trials_night
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.comparison import Comparison
from prefect_robomaker.schemas.reports.run_exit_codes import ANSWER_EXIT_CODES
from prefect_robomaker.schemas.reports.run_record import JobRecord
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.comparison.better_or_worse import compare
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.detection import PlannedTrials, Question, liveliest_pairs, plan_pairs
from prefect_robomaker.tasks.comparison.history import since_last_run


def compared(before: Any, after: Any, **options: Any) -> Comparison:
    return compare(NightRun.of(make_night(before)), NightRun.of(make_night(after, 1)), **options)


@pytest.mark.parametrize(
    ("before", "after", "answer", "p_value"),
    [
        # Six pairs that all got worse are the fewest that the test at 5 % can tell.
        ("PPPPPPPP", "FFFFFFPP", "worse", 0.03125),
        ("FFFFFFPP", "PPPPPPPP", "better", 0.03125),
        ("PPPPPPPP", "FFFFFPPP", "no difference shown", 0.0625),
        ("PPPPFF", "PPFFPP", "no difference shown", 1.0),
        ("PPPP", "PPPP", "no difference shown", 1.0),
    ],
)
def test_the_answer_is_that_of_the_exact_test(before: str, after: str, answer: str, p_value: float) -> None:
    comparison = compared(before, after)
    assert (comparison.answer, comparison.pairs, comparison.alpha) == (answer, len(before), 0.05)
    assert comparison.rate is not None
    assert comparison.rate.p_value == pytest.approx(p_value)
    assert (comparison.rate.before, comparison.rate.after) == (
        before.count("P") / len(before), after.count("P") / len(after)
    )  # fmt: skip
    assert comparison.exit_code == {"better": 0, "worse": 1, "no difference shown": 6, "not comparable": 7}[answer]
    assert (comparison.needed is not None) == (answer == "no difference shown")
    assert f"p = {p_value:.2g} (exact McNemar test, alpha 0.05)" in comparison.why


@pytest.mark.parametrize(
    ("before", "after", "answer"),
    [
        ("P" * 40, "P" * 40, "not worse"),  # 36 pairs without a change exclude 10 points
        ("P" * 20, "P" * 20, "no difference shown"),
        ("P" * 100, "P" * 98 + "FF", "not worse"),
        ("P" * 100, "P" * 94 + "F" * 6, "worse"),
        ("P" * 400, "P" * 392 + "F" * 8, "not worse"),  # shown to be worse, but by two points only
        ("F" * 8 + "P" * 40, "P" * 48, "better"),
    ],
)
def test_a_margin_asks_whether_nothing_got_worse_by_more(before: str, after: str, answer: str) -> None:
    comparison = compared(before, after, margin=0.1)
    assert (comparison.answer, comparison.exit_code) == (answer, ANSWER_EXIT_CODES[comparison.answer])
    assert comparison.rate is not None
    assert comparison.rate.margin is not None
    assert (comparison.rate.margin.outcome == "shown") == (answer in ("not worse", "better"))
    assert "10 points or more" in comparison.why


@pytest.mark.parametrize("rest", ["C" * 10, ""])
def test_trials_that_the_second_run_lacks_may_be_the_fall(rest: str) -> None:
    """Else a run of which the worst tenth was cancelled or left out would be called no worse."""
    comparison = compared("P" * 60, "P" * 50 + rest, margin=0.1)
    assert comparison.answer == "not comparable"
    assert "10 trials that passed in the first run have no verdict" in comparison.why
    assert compared("P" * 50 + "C" * 10, "P" * 50 + rest, margin=0.1).answer == "not worse"


def test_pairs_that_are_needed_to_exclude_a_margin() -> None:
    needed = compared("P" * 20, "P" * 20, margin=0.1).needed
    assert needed is not None
    assert (needed.basis, needed.pairs, needed.more) == ("margin", 165, 145)
    assert needed.assumed == ["20% of pairs differ: these runs have fewer than 20 pairs, or none that differ"]


@pytest.mark.parametrize("letters", [("P" * 40, "P" * 37 + "FFF"), ("P" * 8, "F" * 3 + "P" * 5), ("P" * 22, "P" * 22)])
@pytest.mark.parametrize("kind", ["difference", "margin"])
def test_a_plan_and_a_comparison_need_as_many_pairs(
    letters: tuple[str, str], kind: Literal["difference", "margin"]
) -> None:
    """They assume the same of the same two runs, and say so in the same words."""
    runs = [NightRun.of(make_night(each, number)) for number, each in enumerate(letters)]
    needed = compare(runs[0], runs[1], **{kind: 0.12}).needed
    earlier = liveliest_pairs(runs)
    planned = plan_pairs(Question(kind, 0.12), PlannedTrials(len(letters[0]), len(letters[0])), earlier)
    assert needed is not None
    assert (needed.pairs, needed.discordant, needed.more) == (planned.pairs, planned.discordant, planned.more)
    assert needed.assumed[0].partition(":")[0] == planned.assumed[0].partition(":")[0]


def test_what_changed_is_listed_with_its_reason() -> None:
    comparison = compared("PPFFE", "PFPFP")
    assert [each.cell.title for each in comparison.newly_failing] == ["drive: world-2 scout, seed 7"]
    assert comparison.newly_failing[0].reason == "gentle: 9 N, at most 5 N asked"
    assert (comparison.newly_failing[0].before_job, comparison.newly_failing[0].after_job) == ("sim-0-1", "sim-1-1")
    assert [each.cell.test for each in comparison.newly_passing] == ["world-3 scout", "world-5 scout"]
    assert [each.cell.test for each in comparison.still_failing] == ["world-4 scout"]
    assert comparison.unjudged == 1


def test_a_stricter_alpha_asks_for_more() -> None:
    assert compared("PPPPPPPP", "FFFFFFPP", alpha=0.01).answer == "no difference shown"


def test_needed_pairs_are_for_the_difference_found_asked_for_or_ten_points() -> None:
    # One of four got worse: 25 of 100 differ, all in one direction.
    found = compared("PPPP", "FPPP").needed
    assert found is not None
    assert (found.basis, found.difference, found.discordant, found.pairs, found.more) == (
        "as found",
        0.25,
        0.25,
        31,
        27,
    )
    asked = compared("PPPP", "FPPP", difference=0.1).needed
    assert asked is not None
    assert (asked.basis, asked.discordant, asked.more) == ("asked for", 0.2, asked.pairs - 4)
    none = compared("PPPP", "PPPP").needed
    assert none is not None
    assert (none.basis, none.difference) == ("10 points", 0.1)
    enough = compared("P" * 400, "P" * 400).needed
    assert enough is not None
    assert enough.more == 0


def test_runs_that_differ_in_what_broke_are_compared_only_where_that_does_not_matter() -> None:
    undecided = compared("PPPPPPPPPP", "EEEEEEPPPP")
    assert (undecided.answer, undecided.exit_code) == ("not comparable", 7)
    assert "the answer depends on the 6 pairs of which a side broke" in undecided.why
    assert "no difference shown when they are left out, worse when what broke counts as failed" in undecided.why
    assert compared("PPPPPPPPPP", "EFFFFFFPPP").answer == "worse"
    assert compared("PPPPPPPPPP", "EPPPPPPPPP").answer == "no difference shown"


@pytest.mark.parametrize(
    ("before", "after", "why"),
    [
        ("", "PP", "has no simulation jobs"),
        ("PP", "", "has no simulation jobs"),
        ("PP", "EE", "none of the 2 pairs was judged in both runs: nightly-20260301T020000000 has 2 passed; "
         "nightly-20260302T020000000 has 2 broken"),
        ("PP", "CC", "has 2 canceled"),
        ("NN", "PP", "has 2 no verdict"),
    ],
)  # fmt: skip
def test_runs_without_a_judged_pair_are_not_comparable(before: str, after: str, why: str) -> None:
    comparison = compared(before, after)
    assert (comparison.answer, comparison.rate, comparison.needed) == ("not comparable", None, None)
    assert why in comparison.why


def changed(job: JobRecord, **members: Any) -> JobRecord:
    return job.model_copy(update=members)


def test_runs_without_a_pair_say_what_differs() -> None:
    other_worlds = compared([make_job(0, "P", world="a")], [make_job(0, "P", world="b")])
    assert (other_worlds.only_before, other_worlds.only_after, other_worlds.exit_code) == (1, 1, 7)
    assert "their jobs drove in different worlds" in other_worlds.why
    other_seeds = compared([make_job(0, "P", seed=1)], [make_job(0, "P", seed=2)])
    assert "give the jobs a seed, the same in both runs" in other_seeds.why
    other_steps = compared([make_job(0, "P")], [changed(make_job(0, "P"), step="push")])
    assert "steps with different names" in other_steps.why
    early = compared([changed(make_job(0, "P"), inputs=None)], [make_job(0, "P")])
    assert "nightly-20260301T020000000 does not say which worlds and seeds its jobs had" in early.why


def test_verdicts_of_other_requirements_are_not_compared() -> None:
    strict = compared([make_job(0, "P", limit=5.0)], [make_job(0, "F", limit=2.0)])
    assert (strict.answer, strict.other_requirements) == ("not comparable", 1)
    assert "judged by different requirements" in strict.why
    mixed = compared(
        [make_job(0, "P", limit=5.0), make_job(1, "P")], [make_job(0, "F", limit=2.0), make_job(1, "P")]
    )  # fmt: skip
    assert (mixed.answer, mixed.other_requirements) == ("no difference shown", 1)
    assert mixed.rate is not None
    assert mixed.rate.pairs == 1


def test_a_verdict_without_requirements_is_of_other_requirements() -> None:
    """Such as that of an environment which judges by itself; one that broke was judged by nothing."""
    bare = changed(make_job(0, "P"), requirements=[])
    assert compared([bare], [make_job(0, "F")]).other_requirements == 1
    assert compared([make_job(0, "F")], [bare]).answer == "not comparable"
    assert compared([bare], [bare]).other_requirements == 0
    assert compared([make_job(0, "E")], [make_job(0, "P")]).other_requirements == 0


def test_another_request_is_compared_and_told() -> None:
    comparison = compared([make_job(0, "P", request="a")], [make_job(0, "P", request="b")])
    assert (comparison.pairs, comparison.other_requests) == (1, 1)


def with_metrics(letter: str, values: list[dict[str, float]]) -> list[JobRecord]:
    return [make_job(index, letter, metrics=each) for index, each in enumerate(values)]


def test_metrics_have_paired_intervals_that_hold_together() -> None:
    before = [{"distance_m": 10.0 + i, "hits": 1.0, "time_s": float(i)} for i in range(12)]
    after = [{"distance_m": 11.0 + i + 0.1 * (i % 3), "hits": 1.0, "time_s": i + (-1.0) ** i} for i in range(12)]
    comparison = compared(with_metrics("P", before), with_metrics("P", after))
    distance, hits, time = comparison.metrics
    assert [each.name for each in comparison.metrics] == ["distance_m", "hits", "time_s"]
    assert [each.changed for each in comparison.metrics] == [True, False, False]
    assert (distance.difference, distance.pairs) == (pytest.approx(1.1), 12)
    assert (hits.low, hits.high) == (0, 0)
    assert time.low is not None
    assert time.low < 0
    alone = compared(
        with_metrics("P", [{"distance_m": each["distance_m"]} for each in before]),
        with_metrics("P", [{"distance_m": each["distance_m"]} for each in after]),
    ).metrics[0]
    assert alone.low is not None
    assert distance.low is not None
    assert alone.low > distance.low, "an interval that holds with two others is wider"


def test_metrics_of_what_broke_or_is_not_finite_do_not_count() -> None:
    before = [make_job(0, "P", metrics={"x": 1.0}), make_job(1, "P", metrics={"x": 1.0})]
    after = [make_job(0, "P", metrics={"x": float("nan")}), make_job(1, "F", metrics={"x": 3.0, "y": 1.0})]
    (only,) = compared(before, after).metrics
    assert (only.name, only.pairs, only.difference, only.low, only.changed) == ("x", 1, 2.0, None, False)


def to_bed(index: int, margin: float, unit: str = "s") -> JobRecord:
    goal = Requirement(name="to-bed", kind="goal", satisfied=unit == "s", detail="", unit=unit, margin=margin)
    return make_job(index, "P" if unit == "s" else "F").model_copy(update={"requirements": [goal]})


def test_times_left_at_goals_are_compared_where_both_robots_reached_them() -> None:
    """The margin of a goal that was missed is a distance."""
    before = [to_bed(index, 50.0 + index) for index in range(4)]
    after = [*(to_bed(index, 30.0 + index) for index in range(3)), to_bed(3, -2.0, "m")]
    (margin,) = compared(before, after).margins
    assert (margin.name, margin.unit, margin.pairs, margin.difference, margin.fell) == ("to-bed", "s", 3, -20.0, 3)


@pytest.mark.parametrize(
    ("states", "identical", "told"), [("abcd", 4, "nothing changed"), ("abcx", 3, "too few pairs to tell")]
)
def test_pairs_that_went_through_the_same_states_need_no_more_pairs(
    tmp_path: Path, states: str, identical: int, told: str
) -> None:
    before = make_trials_night(["PPPF"], runs=tmp_path, states="abcd")
    after = make_trials_night(["PPPF"], 1, runs=tmp_path, states=states)
    comparison = compare(NightRun.of(before), NightRun.of(after))
    assert (comparison.identical, comparison.answer_in_words) == (identical, told)
    assert (comparison.needed is None) == (told == "nothing changed")
    assert (comparison.answer, comparison.exit_code) == ("no difference shown", 6)


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("PPP", "FPP", "1 of 3 jobs newly fails, and none newly passes"),
        ("PPF", "FFP", "2 of 3 jobs newly fail, and 1 newly passes"),
        ("PFF", "PPP", "2 of 3 jobs newly pass, and none newly fails"),
        ("PPP", "PPP", ""),
        ("P" * 8, "F" * 8, ""),
    ],
    ids=["one fails", "both", "two pass", "none", "the answer says it"],
)
def test_jobs_that_turned_are_told_although_chance_may_do_that(before: str, after: str, told: str) -> None:
    assert compared(before, after).turned_in_words == told


def test_nothing_changed_is_said_only_if_all_pairs_were_judged_alike(tmp_path: Path) -> None:
    """A trial that broke has no states to compare."""
    before = make_trials_night(["PPP"], runs=tmp_path, states="abc")
    after = make_trials_night(["PPE"], 1, runs=tmp_path, states="abx")
    comparison = compare(NightRun.of(before), NightRun.of(after))
    assert (comparison.identical, comparison.unjudged) == (2, 1)
    assert comparison.answer_in_words != "nothing changed"


LETTERS = st.text("PFECN", max_size=30)


@given(LETTERS, LETTERS)
def test_two_runs_the_other_way_round_get_the_opposite_answer(before: str, after: str) -> None:
    there, back = compared(before, after), compared(after, before)
    opposite = {"better": "worse", "worse": "better"}
    assert back.answer == opposite.get(there.answer, there.answer)
    assert there.exit_code == ANSWER_EXIT_CODES[there.answer]
    assert there.pairs == min(len(before), len(after))
    assert (there.only_before, there.only_after) == (len(before) - there.pairs, len(after) - there.pairs)
    assert {each.cell.test for each in there.newly_failing} == {each.cell.test for each in back.newly_passing}


def test_trials_of_a_job_that_was_not_run_to_its_end_count_neither_here_nor_in_the_report(tmp_path: Path) -> None:
    before, after = (
        make_trials_night(trials, night, runs=tmp_path)
        for night, trials in enumerate((("FFFF", "FFFF"), ("PPFF", "PPPP")))
    )
    last = after.jobs[1].model_copy(update={"status": "Canceled", "verdict": None})
    after = after.model_copy(update={"jobs": [after.jobs[0], last]})
    nights = NightRun.of(before), NightRun.of(after)

    found = [
        [(each.name, each.newly_met, each.pairs) for each in told.requirements]
        for told in (compare(*nights, alpha=0.05, difference=None), since_last_run(nights))
    ]
    assert found[0] == found[1] == [("gentle", 2, 4)]
