"""Known failures: which failures they explain, until when, and what is said of those that did not occur."""

from datetime import date, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.known_failures import (
    KnownFailure,
    KnownMatch,
    ReportedFailures,
    idle_failures,
    known_failure,
    partly_known,
)

DAY = date(2027, 1, 15)


def known(requirement: str = "clearance", job: str = "*", until: date = DAY, owner: str = "anna") -> KnownFailure:
    return KnownFailure(match=KnownMatch(job=job, requirement=requirement), owner=owner, until=until)


def job(name: str, missed: list[str] | None) -> ReportedFailures:
    return ReportedFailures((name,), None if missed is None else tuple(missed))


def test_a_failure_is_known_if_each_missed_requirement_is() -> None:
    ours, theirs = known("clearance"), known("rooms_*", owner="ben", until=DAY - timedelta(days=1))
    before = DAY - timedelta(days=2)
    assert known_failure(job("world-1 scout", ["clearance"]), [ours, theirs], DAY) == ours
    assert known_failure(job("world-1 scout", ["clearance", "rooms_visited"]), [ours, theirs], before) == theirs
    assert known_failure(job("world-1 scout", ["clearance", "rooms_visited"]), [ours, theirs], DAY) is None, (
        "one is over"
    )
    assert known_failure(job("world-1 scout", ["clearance", "time"]), [ours, theirs], before) is None, "one is new"
    assert known_failure(job("world-1 scout", []), [ours], DAY) is None, "it failed for no requirement"


def test_it_is_about_the_jobs_that_it_names() -> None:
    entry = known(job="world-3 *")
    assert known_failure(job("world-3 scout", ["clearance"]), [entry], DAY) == entry
    assert known_failure(job("world-30 scout", ["clearance"]), [entry], DAY) is None


@given(
    st.lists(st.sampled_from(["a", "b", "c"]), max_size=3),
    st.lists(st.builds(known, st.sampled_from(["a", "b", "*"]), until=st.dates(DAY, DAY + timedelta(3))), max_size=3),
    st.integers(0, 5),
)
def test_nothing_is_known_later_that_was_not_known_before(
    missed: list[str], entries: list[KnownFailure], days: int
) -> None:
    later = known_failure(job("job", missed), entries, DAY + timedelta(days))
    assert later is None or (later.until >= DAY + timedelta(days) and known_failure(job("job", missed), entries, DAY))


@pytest.mark.parametrize(
    ("missed", "day", "said"),
    [
        (["clearance"], DAY, []),
        ([], DAY,
         ["the known failure of clearance in any job (anna) did not occur; if it is mended, remove it from `known`"]),
        (["clearance"], DAY + timedelta(1),
         ["the known failure of clearance in any job (anna) was known until 2027-01-15; it counts again"]),
    ],
)  # fmt: skip
def test_what_is_mended_or_over_is_told(missed: list[str], day: date, said: list[str]) -> None:
    assert idle_failures([job("world-1 scout", missed)], [known()], day) == said
    assert idle_failures([job("world-1 scout", None)], [known()], DAY) == [], "it broke: the failure may be there yet"
    assert idle_failures([], [known()], DAY) == []


def test_an_entry_that_is_about_no_job_is_told_with_a_name_that_would_be_right() -> None:
    there = ReportedFailures(("scout in flat 3", "world-3 scout"), ("clearance",))
    for pattern in ("scout in flat 3*", "world-3 *"):
        assert known_failure(there, [known(job=pattern)], DAY)
        assert idle_failures([there], [known(job=pattern)], DAY) == []
    assert idle_failures([there], [known(job="scout in flat 4")], DAY) == [
        "the known failure of clearance in scout in flat 4 (anna) is about no job of this run, as 'scout in flat 3' or "
        "'world-3 scout' is"
    ]


def test_an_entry_whose_day_is_over_counts_again_only_where_it_occurs() -> None:
    over = [known(until=DAY - timedelta(1))]
    assert idle_failures([job("scout", ["clearance"])], over, DAY) == [
        "the known failure of clearance in any job (anna) was known until 2027-01-14; it counts again"
    ]
    assert idle_failures([job("scout", ["time"])], over, DAY) == [
        "the known failure of clearance in any job (anna) was known until 2027-01-14 and did not occur; if it is "
        "mended, remove it from `known`"
    ]
    assert idle_failures([job("scout", ["clearance"])], [known(job="rover", until=DAY - timedelta(1))], DAY) == [
        "the known failure of clearance in rover (anna) is about no job of this run, as 'scout' is; its last day was "
        "2027-01-14: remove it from `known`"
    ]


def test_a_job_that_missed_more_than_is_known_is_said_to_count_as_failed() -> None:
    def said(*jobs: ReportedFailures, until: date = DAY) -> list[str]:
        entries = [known("gentle", "*seed=4", until), known("clear*", owner="ben")]
        return partly_known([(each.names[0], each) for each in jobs], entries, DAY)

    assert said(job("drive seed=4", ["gentle", "no_hard_collision"])) == [
        "gentle of drive seed=4 is known (anna), no_hard_collision is not: the job counts as failed"
    ]
    assert said(
        job("a seed=4", ["gentle", "clearance", "x", "y"]), job("b seed=4", ["gentle", "clearance", "x", "y"])
    ) == [
        "gentle and clearance of 2 jobs, such as a seed=4, are known (anna and ben), x and y are not: the jobs count "
        "as failed"
    ]
    assert said(job("seed=4", ["gentle"]), job("seed=5", ["x"]), job("seed=4", []), job("seed=4", None)) == []
    assert said(job("seed=4", ["gentle", "x"]), until=DAY - timedelta(1)) == [], "nothing of it is known today"


def test_who_mends_it_until_when_and_why_is_told() -> None:
    assert str(known()) == "anna until 2027-01-15"
    assert str(known().model_copy(update={"why": "ticket 512"})) == "anna until 2027-01-15: ticket 512"


@pytest.mark.parametrize("until", ["soon", "2027-13-01", 20270115, None, ["2027-01-15"]])
def test_what_is_no_day_is_told_with_one_that_is(until: object) -> None:
    with pytest.raises(ValueError, match="a day is written as in 2027-01-15"):
        KnownFailure.model_validate({"match": {"requirement": "clearance"}, "owner": "anna", "until": until})


def test_an_entry_whose_requirement_no_job_has_is_told_with_those_that_there_are() -> None:
    there = [ReportedFailures(("scout",), (), ("polite", "to-bed"))]
    assert idle_failures(there, [known("gentle")], DAY) == [
        "the known failure of gentle in any job (anna) marks no failure: no job has a requirement `gentle`; there are "
        "polite, to-bed"
    ]
    (mended,) = idle_failures(there, [known("pol*")], DAY)
    assert "did not occur" in mended
    (rare,) = idle_failures(there, [known("above_floor")], DAY)
    assert "did not occur" in rare, "a job has it only where it missed it"


def test_a_requirement_of_trials_is_not_said_to_be_mended_where_they_failed() -> None:
    """Trials had missed it, and the sentence asked to remove the entry."""
    (told,) = idle_failures([job("world-1 scout", ["trials"])], [known()], DAY)
    assert told.endswith("`requirement: trials` would cover all of them")
    assert idle_failures([job("world-1 scout", ["trials"])], [known(requirement="trials")], DAY) == []
