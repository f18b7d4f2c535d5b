"""Sentences about causes of failures have numbers that fit together."""

import re

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.causes import Claim, Effect, FailureGroup

_COUNTS = st.integers(0, 99)


@given(first=_COUNTS, later=_COUNTS, outside=_COUNTS, met=_COUNTS)
def test_a_cause_says_each_count_once(first: int, later: int, outside: int, met: int) -> None:
    """Trials that missed the requirement after another are counted, too, where nearly no trial passes."""
    inside = first + later
    claim = Claim(
        kind="axis", axes=["SPEED"], region="SPEED = fast", failed_inside=inside, trials_inside=inside,
        failed_outside=outside, trials_outside=outside + met, lift=8.0, low=4.0, high=16.0, p_value=0.001,
        scope="these worlds only", failed_otherwise=later + outside + met,
    )  # fmt: skip
    group = FailureGroup(
        requirement="polite", room="Hall", failed=first, claims=[claim], job="sim-1", trial=1, command=""
    )
    found = re.match(
        r"with SPEED = fast, all (\d+) trials? missed polite(, in Hall)?; elsewhere (\S+) of (\d+)", group.cause
    )
    assert found is not None
    assert (int(found[1]), int(found[4])) == (inside, outside + met)
    assert found[3] == (str(outside) if outside else "none")
    assert bool(found[2]) == (not claim.failed_otherwise), "of trials that missed it later the room is not known"
    assert ("times as often" in group.cause) == bool(outside)


def test_a_change_of_failures_that_is_no_claim_says_why() -> None:
    shown = Effect(on="", start=0.0, end=1.0, change=0.2, low=0.1, high=0.3)
    assert not shown.is_shown
    assert shown.in_words.endswith(", which is no claim: all axes, their pairs and worlds together leave it to chance")
    untested = Effect(on="", start=0.0, end=1.0, change=0.2, low=0.1, high=0.3, is_tested=False)
    assert untested.in_words.endswith(", which is no claim, as none with this axis was tested; Why says the reason")
    assert Effect(on="polite", start=0.0, end=1.0, change=0.2, low=0.1, high=0.3).is_shown
