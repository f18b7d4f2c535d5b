"""Runs with trials are compared trial by trial, by a test that respects worlds."""

from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_job, make_night, make_trials_night, store_night, trials_of

from prefect_robomaker.schemas.reports.comparison import Comparison
from prefect_robomaker.tasks.comparison.better_or_worse import compare
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.results.table import RESULTS_FILE, ResultTable


def compared(before: list[str], after: list[str], runs: Path, **more: Any) -> Comparison:
    nights = [make_trials_night(each, night, runs=runs, **more) for night, each in enumerate((before, after))]
    return compare(*(NightRun.of(each) for each in nights))


def test_forty_trials_that_all_got_worse_in_one_world_are_worse_there(tmp_path: Path) -> None:
    found = compared(["P" * 40], ["F" * 40], tmp_path)
    assert (found.answer, found.exit_code, found.pairs, found.trials) == ("worse", 1, 1, 40)
    assert found.rate is not None
    assert (found.rate.pairs, found.rate.worlds, found.rate.test) == (40, 1, "exact McNemar")
    assert found.why.startswith("40 pairs judged in both runs, in 1 world, p = 1.8e-12 (exact McNemar test")
    assert found.why.endswith("it holds in this world, as other worlds were not tried")


def test_pairs_that_repeat_another_one_state_by_state_count_once(tmp_path: Path) -> None:
    """A seed or an axis that changes nothing would make any difference sure."""
    copies = compared(["P" * 16], ["F" * 16], tmp_path / "copies", states="abcd" * 4)
    assert copies.rate is not None
    assert (copies.answer, copies.rate.pairs, copies.trials) == ("no difference shown", 4, 16)
    assert copies.why.endswith("; 12 pairs repeat another pair state by state and do not count")
    kept = compared(["P" * 16], ["P" * 16], tmp_path / "kept", states="abcdefghijklmnop", worlds=[None])
    assert "repeat" not in kept.why
    # A repeated pair is none that the second run lost.
    passing = [make_trials_night(["P" * 400], night, runs=tmp_path / "p", states="ab" * 200) for night in (0, 1)]
    found = compare(*map(NightRun.of, passing), margin=0.9)
    assert "have no verdict" not in found.why


def test_jobs_without_trials_that_repeat_another_one_count_once() -> None:
    """Their digests are in the records; of two that ended otherwise, judged by other requirements, both count."""

    def night(letters: str, number: int) -> NightRun:
        jobs = [make_job(index, letter, night=number, world="flat").model_copy(update={"state_digest": f"{number}"})
                for index, letter in enumerate(letters)]  # fmt: skip
        return NightRun.of(make_night(letters, number).model_copy(update={"jobs": jobs}))

    found = compare(night("P" * 10, 0), night("F" * 9 + "P", 1))
    assert found.rate is not None
    assert (found.answer, found.rate.pairs) == ("no difference shown", 2)


def test_jobs_without_a_world_have_no_other_worlds(tmp_path: Path) -> None:
    found = compared(["P" * 20], ["F" * 20], tmp_path, worlds=[None])
    assert (found.answer, found.rate and found.rate.worlds) == ("worse", 1)
    assert "other worlds" not in found.why


def test_six_worlds_are_flipped_as_a_whole(tmp_path: Path) -> None:
    """Ten trials that got worse in one of seven worlds say nothing of other worlds."""
    one = compared(["P" * 10] * 7, ["F" * 10, *["P" * 10] * 6], tmp_path / "one")
    assert (one.answer, one.rate and one.rate.test, one.rate and one.rate.p_value) == (
        "no difference shown", "sign flip of worlds", 1.0
    )  # fmt: skip
    assert one.needed is not None
    assert one.needed.worlds is not None
    assert one.needed.pairs == 10 * one.needed.worlds > 70
    # What newly failed in that world, with the same seeds, is said nonetheless.
    [gentle] = one.requirements
    assert (gentle.newly_missed, gentle.pairs, gentle.places[0].certain) == (10, 70, True)
    all_worse = compared(["P" * 10] * 6, ["F" + "P" * 9] * 6, tmp_path / "all")
    assert (all_worse.answer, all_worse.rate and all_worse.rate.p_value) == ("worse", pytest.approx(0.03125))
    assert "in 6 worlds" in all_worse.why
    assert "other worlds" not in all_worse.why


def test_jobs_of_one_world_are_one_world(tmp_path: Path) -> None:
    """Six jobs, of two robots or settings, in three worlds: three worlds are too few to flip."""
    worlds = ["a", "a", "b", "b", "c", "c"]
    found = compared(["PP"] * 6, ["FF"] * 6, tmp_path, worlds=worlds)
    assert (found.answer, found.rate and found.rate.worlds, found.rate and found.rate.test) == (
        "worse", 3, "exact McNemar"
    )  # fmt: skip
    assert found.why.endswith("it holds in these worlds, as other worlds were not tried")


def test_trials_that_only_one_run_has_are_counted(tmp_path: Path) -> None:
    found = compared(["P" * 10], ["P" * 4], tmp_path)
    assert (found.trials, found.trials_only_before, found.trials_only_after) == (4, 6, 0)


def test_trials_that_broke_decide_nothing(tmp_path: Path) -> None:
    found = compared(["P" * 20], ["E" * 12 + "P" * 8], tmp_path)
    assert (found.answer, found.unjudged) == ("not comparable", 12)
    assert "the 12 pairs of which a side broke" in found.why


def test_a_table_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    before, after = (make_trials_night(["P" * 9], night, runs=tmp_path) for night in (0, 1))
    (after.run_dir / "results.parquet").write_bytes(b"PAR1 but not really")
    (before.run_dir / "results.parquet").unlink()
    found = compare(NightRun.of(before), NightRun.of(after))
    assert found.trials == 1
    assert len(found.troubles) == 2
    for run, trouble in zip((before, after), found.troubles, strict=True):
        assert f"`robomaker report {run.run_id}` writes it again" in trouble


def test_a_job_that_fails_in_another_way_says_so(tmp_path: Path) -> None:
    """It missed the goal before; now it reaches it, hits a wall and tips over."""

    def night(number: int, missed: set[str], free: bool = False) -> NightRun:
        job = make_job(0, "F", night=number)
        asked = [
            job.requirements[0].model_copy(update={"name": name, "satisfied": name not in missed, "detail": f"{name}!"})
            for name in ("goal", "gentle", "upright")
        ]
        return NightRun.of(make_night([job.model_copy(update={"requirements": asked, "runs_free": free})], number))

    found = compare(night(0, {"goal"}), night(1, {"gentle", "upright"}))
    assert [(each.name, each.newly_missed, each.newly_met) for each in found.requirements] == [
        ("gentle", 1, 0), ("upright", 1, 0), ("goal", 0, 1)
    ]  # fmt: skip
    assert found.still_failing[0].newly_missed == ["gentle", "upright"]
    assert (found.requirements[0].places[0].detail, found.requirements[0].places[0].certain) == ("gentle!", True)
    free = compare(night(0, {"goal"}, free=True), night(1, {"gentle"}, free=True))
    assert not free.requirements[0].places[0].certain


def test_a_health_requirement_that_appears_is_newly_missed() -> None:
    """Results have it only where it was missed: `above_floor`."""
    before, after = make_job(0, "P"), make_job(0, "F", night=1)
    fell = after.requirements[0].model_copy(update={"name": "above_floor", "kind": "health", "detail": "3 m below"})
    after = after.model_copy(update={"requirements": [*before.requirements, fell]})
    found = compare(NightRun.of(make_night([before])), NightRun.of(make_night([after], 1)))
    assert [(each.name, each.newly_missed) for each in found.requirements] == [("above_floor", 1)]


def test_trials_are_matched_by_their_parameters_too(tmp_path: Path) -> None:
    runs = []
    for night, speed in enumerate(("1", "2")):
        record = make_night([make_job(0, "P", night=night)], night, runs=tmp_path)
        table = trials_of("PPP", axes={"SPEED": speed})
        ResultTable.of(record.jobs, lambda job, table=table: table).write(store_night(record) / RESULTS_FILE)
        runs.append(NightRun.of(record))
    found = compare(*runs)
    assert (found.trials, found.answer) == (0, "not comparable")
    assert "no trials are pairs: axis SPEED is 1 in the first run and 2 in the second run" in found.why


def test_another_limit_is_no_other_way_of_failing() -> None:
    """9 N were at most 10 N, and are more than 5 N: the question changed, not the robot."""
    lenient = make_job(0, "P", limit=10.0)
    strict = make_job(0, "F", night=1, limit=5.0)
    found = compare(NightRun.of(make_night([lenient])), NightRun.of(make_night([strict], 1)))
    assert (found.answer, found.requirements, found.margins) == ("not comparable", [], [])


def test_a_job_that_was_canceled_after_ten_trials_judged_none(tmp_path: Path) -> None:
    before = make_trials_night(["P" * 10], 0, runs=tmp_path)
    canceled = make_trials_night(["F" * 10], 1, runs=tmp_path)
    jobs = [job.model_copy(update={"status": "Canceled", "verdict": None}) for job in canceled.jobs]
    ResultTable.of(jobs, lambda job: trials_of("F" * 10)).write(canceled.run_dir / RESULTS_FILE)
    found = compare(NightRun.of(before), NightRun.of(canceled.model_copy(update={"jobs": jobs})))
    assert (found.answer, found.unjudged) == ("not comparable", 10)


def test_a_stricter_alpha_takes_more_worlds_to_flip(tmp_path: Path) -> None:
    """At 1 % six worlds cannot show anything: 2 / 2**6 is 3 %."""
    runs = [make_trials_night([each * 8] * 6, night, runs=tmp_path) for night, each in enumerate("PF")]
    found = compare(*(NightRun.of(each) for each in runs), alpha=0.01)
    assert (found.answer, found.rate and found.rate.test) == ("worse", "exact McNemar")


def test_trials_that_were_lost_are_said(tmp_path: Path) -> None:
    """A store that was away while the report was made."""
    before, after = (make_trials_night(["P" * 9], night, runs=tmp_path) for night in (0, 1))
    ResultTable.of(after.jobs).write(after.run_dir / RESULTS_FILE)
    found = compare(NightRun.of(before), NightRun.of(after))
    assert found.trials == 0
    assert f"the trials of {after.jobs[0].label} are not in" in found.troubles[0]
