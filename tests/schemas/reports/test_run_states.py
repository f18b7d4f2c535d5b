"""The end of a run: its state from its jobs, and in words."""

from datetime import date

import pytest
from helpers.night_records import make_night

from prefect_robomaker.schemas.known_failures import KnownFailure, KnownMatch
from prefect_robomaker.schemas.reports.run_record import RerunOf
from prefect_robomaker.schemas.reports.run_states import (
    counts_in_words,
    in_words,
    outcomes_in_words,
    run_state,
    with_known,
)
from prefect_robomaker.schemas.runs.plan import Requirement


def test_outcomes_are_counted_the_most_frequent_first() -> None:
    many = ["failed", *["passed"] * 3, "broken", "failed"]

    assert outcomes_in_words(many) == "6 jobs: 3 passed, 2 failed, 1 broken"
    assert outcomes_in_words(["passed"]) == "1 job: 1 passed"
    assert outcomes_in_words([]) == "0 jobs"


@pytest.mark.parametrize(
    ("letters", "about", "state", "said"),
    [
        ("PF", "*", "succeeded", "1 of 2 verdicts pass, 1 failure known"),
        ("PF", "world-2 *", "succeeded", "1 of 2 verdicts pass, 1 failure known"),
        ("PF", "world-1 *", "failed", "1 of 2 verdicts pass"),
        ("FF", "world-2 *", "failed", "0 of 2 verdicts pass, 1 failure known"),
        ("FE", "*", "broken", "0 of 1 verdicts pass, 1 failure known, 1 broke"),
        ("FC", "*", "canceled", "0 of 1 verdicts pass, 1 failure known, 1 canceled"),
    ],
)
def test_only_a_fail_can_be_known_and_it_makes_no_run_red(letters: str, about: str, state: str, said: str) -> None:
    known = KnownFailure(match=KnownMatch(job=about, requirement="gentle"), owner="anna", until=date(2026, 3, 1))
    night = make_night(letters).model_copy(update={"known": [known]})

    jobs, notes = with_known(night, night.jobs)

    assert (run_state(["Completed"], jobs), counts_in_words(jobs)) == (state, said)
    assert bool(notes) == (about == "world-1 *" and letters == "PF")
    assert [job.known for job in with_known(night.model_copy(update={"known": []}), night.jobs)[0]] == ["", ""]
    # What is known is not named as the worst; the day after, it is.
    assert ("FAIL" in in_words("failed", jobs)) == (state == "failed")
    not_judged = [job.model_copy(update={"verdict": "ERROR"}) for job in night.jobs if job.verdict == "FAIL"]
    assert not any(job.known for job in with_known(night, not_judged)[0]), "it missed it, but not all was judged"
    later = make_night(letters, night=1).model_copy(update={"known": [known]})
    assert not any(job.known for job in with_known(later, later.jobs)[0])


def test_what_fails_for_more_than_requirements_is_not_known() -> None:
    known = KnownFailure(match=KnownMatch(requirement="*"), owner="anna", until=date(2026, 3, 1))
    night = make_night("F").model_copy(update={"known": [known]})
    more = [job.model_copy(update={"unnamed_failure": True}) for job in night.jobs]
    (named,), _ = with_known(night, night.jobs)
    (unnamed,), _ = with_known(night, more)
    assert (bool(named.known), bool(unnamed.known)) == (True, False)
    _, notes = with_known(night, more)
    assert [note.partition(":")[0] for note in notes] == [
        f"{more[0].title} is not known, though the requirements that it missed are"
    ]
    assert "environment's own verdict" in notes[0]


def test_a_job_that_missed_more_than_is_known_is_told_and_red() -> None:
    known = KnownFailure(match=KnownMatch(requirement="gentle"), owner="anna", until=date(2026, 3, 1))
    night = make_night("F").model_copy(update={"known": [known]})
    own = Requirement(name="no_hard_collision", satisfied=False, detail="30 N")
    jobs = [job.model_copy(update={"requirements": [*job.requirements, own]}) for job in night.jobs]
    marked, notes = with_known(night, jobs)
    assert run_state(["Completed"], marked) == "failed"
    assert notes == [f"gentle of {jobs[0].title} is known (anna), no_hard_collision is not: the job counts as failed"]


def test_a_known_failure_of_trials_says_what_it_covers() -> None:
    known = KnownFailure(match=KnownMatch(requirement="trials"), owner="anna", until=date(2026, 3, 1))
    night = make_night("F").model_copy(update={"known": [known]})
    trials = Requirement(name="trials", satisfied=False, detail="3 of 40 trials failed; trial 7 first: upright")
    jobs = [job.model_copy(update={"requirements": [trials]}) for job in night.jobs]
    (marked,), notes = with_known(night, jobs)
    assert marked.known == ("anna until 2026-03-01; covers all trials that failed")
    assert notes == []


def test_a_rerun_of_some_jobs_says_nothing_of_known_failures_of_the_others() -> None:
    known = KnownFailure(match=KnownMatch(job="world-9 *", requirement="*"), owner="anna", until=date(2026, 3, 1))
    night = make_night("F").model_copy(update={"known": [known]})
    rerun = RerunOf(run_id="nightly-1", selection="failed", jobs_total=9, earlier={"drive": ["sim-1: FAIL"]})
    assert with_known(night, night.jobs)[1]
    assert not with_known(night.model_copy(update={"rerun_of": rerun}), night.jobs)[1]


def test_a_rerun_calls_jobs_as_the_whole_run_did() -> None:
    """Its only job is its first, however many there were before: that is not what an entry about the first means."""
    known = KnownFailure(match=KnownMatch(job="world-1 *", requirement="*"), owner="anna", until=date(2026, 3, 1))
    night = make_night("F").model_copy(update={"known": [known]})
    jobs = [job.model_copy(update={"earlier": "sim-5: FAIL"}) for job in night.jobs]
    for names, is_known in ((["world-1 scout"], True), (["world-5 scout"], False)):
        rerun = RerunOf(run_id="1", selection="failed", jobs_total=9, earlier={}, names={"sim-5": names})
        (marked,), _ = with_known(night.model_copy(update={"rerun_of": rerun}), jobs)
        assert bool(marked.known) == is_known
