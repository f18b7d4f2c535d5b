"""The end of a run: its state from its jobs, and in words."""

from datetime import date

import pytest
from helpers.night_records import make_night

from prefect_robomaker.schemas.known_failures import KnownFailure, KnownMatch
from prefect_robomaker.schemas.reports.run_record import RerunOf, RunState
from prefect_robomaker.schemas.reports.run_states import (
    count_outcomes,
    counts_in_words,
    in_words,
    outcomes_in_words,
    run_state,
    state_in_words,
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
        ("PF", "*", "succeeded", "1 of 2 jobs passed, 1 failure known"),
        ("PF", "world-2 *", "succeeded", "1 of 2 jobs passed, 1 failure known"),
        ("PF", "world-1 *", "failed", "1 of 2 jobs passed"),
        ("FF", "world-2 *", "failed", "0 of 2 jobs passed, 1 failure known"),
        ("FE", "*", "broken", "0 of 2 jobs passed, 1 failure known, 1 broke"),
        ("FC", "*", "canceled", "0 of 2 jobs passed, 1 failure known, 1 canceled"),
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


@pytest.mark.parametrize(
    ("letters", "state", "word"),
    [
        ("PP", "succeeded", "passed"),
        ("PN", "succeeded", "succeeded"),
        ("PC", "succeeded", "succeeded"),
        ("", "succeeded", "succeeded"),
        ("PF", "failed", "failed"),
    ],
)
def test_a_run_is_said_to_have_passed_only_if_each_job_has(letters: str, state: RunState, word: str) -> None:
    jobs = make_night(letters).jobs

    assert state_in_words(state, count_outcomes(jobs)) == word
    assert in_words(state, jobs).startswith(word)


def test_trials_are_counted_beside_jobs() -> None:
    """A job without trials counts as one, as in the report."""
    passed, failed = make_night("PF").jobs
    all_trials = Requirement(name="trials", satisfied=True, detail="2 of 50 trials did not pass")
    metrics = {"trials": 50.0, "trials_passed": 48.0}
    swept = passed.model_copy(update={"metrics": metrics, "requirements": [all_trials]})
    assert counts_in_words([swept]) == "1 of 1 job passed (48 of 50 trials passed)"
    assert counts_in_words([swept, failed]) == "1 of 2 jobs passed (48 of 51 trials passed)"
    assert counts_in_words([passed, failed]) == "1 of 2 jobs passed"
    broken, unjudged = make_night("EN").jobs
    unfinished = passed.model_copy(update={"status": "Running", "verdict": None})
    assert counts_in_words([swept, broken]) == "1 of 2 jobs passed (48 of 50 trials passed), 1 broke", (
        "it has no trials"
    )
    assert "(48 of 50 trials passed), 2 unfinished" in counts_in_words([swept, unfinished, unfinished])
    assert "(48 of 50 trials passed), 1 without a verdict" in counts_in_words([swept, unjudged])
    half = metrics | {"trials_passed": 44.0, "trials_errors": 4.0}
    both = failed.model_copy(update={"metrics": half, "requirements": [all_trials]})
    assert counts_in_words([both]) == "0 of 1 job passed (44 of 50 trials passed, 4 broke)"
    assert counts_in_words([both, broken]).endswith("(44 of 50 trials passed, 4 broke), 1 broke")
    own = failed.model_copy(update={"metrics": {"trials": float("nan")}})
    assert counts_in_words([own]) == "0 of 1 job passed", "a metric of the application that is called so"


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


def test_a_known_failure_may_name_a_job_as_junit_does() -> None:
    known = KnownFailure(match=KnownMatch(job="scout in flat 3", requirement="*"), owner="anna", until=date(2026, 3, 1))
    night = make_night("F").model_copy(update={"known": [known]})
    names = {"name": "scout in flat 3 (generation-8285)", "case_name": "scout in flat 3"}
    (marked,), notes = with_known(night, [job.model_copy(update=names) for job in night.jobs])
    assert (marked.known, notes) == ("anna until 2026-03-01", [])


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
