"""The one function that makes a run's verdict."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import Requirement, Verdict
from prefect_robomaker.schemas.runs.requirement_kinds.kind import NOT_READ
from prefect_robomaker.tasks.runtime.episode.run_results import (
    OWN_VERDICT,
    EnvironmentReport,
    Episode,
    Findings,
    make_result,
)
from prefect_robomaker.tasks.runtime.episode.verdicts import Parts, TrialParts, decide_verdict

MET = Requirement(name="met", satisfied=True, detail="")
MISSED = Requirement(name="missed", satisfied=False, detail="")
BROKEN = Requirement(name="broken", satisfied=False, detail="", error="no body")
IGNORED = MISSED.model_copy(update={"counts": False})

requirements = st.lists(st.sampled_from([MET, MISSED, BROKEN, IGNORED]), max_size=4)
verdicts: st.SearchStrategy[Verdict] = st.sampled_from(["PASS", "FAIL", "ERROR", "NONE"])


@pytest.mark.parametrize(
    ("parts", "verdict"),
    [
        (Parts(), "NONE"),
        (Parts(own="PASS"), "PASS"),
        (Parts(requirements=[MET]), "PASS"),
        (Parts(requirements=[IGNORED]), "NONE"),
        (Parts(own="PASS", requirements=[IGNORED, MET]), "PASS"),
        (Parts(own="PASS", requirements=[MET, MISSED]), "FAIL"),
        (Parts(own="FAIL", requirements=[MET]), "FAIL"),
        (Parts(own="FAIL", requirements=[BROKEN]), "ERROR"),
        (Parts(own="ERROR", requirements=[MISSED]), "ERROR"),
        (Parts(own="PASS", defects=[BROKEN]), "ERROR"),
        (Parts(own="PASS", defects=[MISSED]), "FAIL"),
        (Parts(own="ERROR", requirements=[BROKEN], defects=[MISSED]), "FAIL"),
        (Parts(own="PASS", defects=[MISSED, BROKEN]), "ERROR"),
        (Parts(own="FAIL", requirements=[BROKEN], is_canceled=True), "NONE"),
    ],
)
def test_the_worse_part_counts(parts: Parts, verdict: Verdict) -> None:
    assert decide_verdict(parts) == verdict


@given(verdicts, requirements, requirements)
def test_a_pass_has_no_part_that_is_not_met(
    own: Verdict, judged: list[Requirement], defects: list[Requirement]
) -> None:
    verdict = decide_verdict(Parts(own=own, requirements=judged, defects=defects))
    counted = [item for item in judged if item.counts]
    if verdict == "PASS":
        assert own in ("PASS", "NONE")
        assert own == "PASS" or counted
        assert all(item.satisfied for item in [*counted, *defects])
    if verdict == "NONE":
        assert own == "NONE"
        assert not counted


@pytest.mark.parametrize(
    ("passed", "failed", "errors", "unjudged", "verdict"),
    [
        (3, 0, 0, 0, "PASS"),
        (2, 1, 0, 0, "FAIL"),
        (1, 1, 1, 0, "FAIL"),
        (2, 0, 1, 0, "ERROR"),
        (2, 0, 0, 0, "ERROR"),
        (2, 0, 0, 1, "ERROR"),
        (0, 0, 0, 3, "NONE"),
    ],
)
def test_trials(passed: int, failed: int, errors: int, unjudged: int, verdict: Verdict) -> None:
    assert decide_verdict(Parts(trials=TrialParts(3, passed, failed, errors, unjudged))) == verdict


def test_goals_that_end_a_run_count_alone_also_while_topics_are_to_be_judged() -> None:
    """Further requirements of the environment do not count, whatever else the job asks for."""
    report = EnvironmentReport(verdict="FAIL", requirements=[MISSED])
    topic = Requirement(name="often", satisfied=False, detail="", error=NOT_READ)
    result = make_result(Episode("requirements", report, 20, 1.0, 1.0), 1, [Findings(requirements=[MET, topic])])
    assert result.extra[OWN_VERDICT] == "PASS"
    assert [item.counts for item in result.requirements] == [False, True, True]
