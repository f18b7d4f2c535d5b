"""Expressions are evaluated within bounds, and otherwise as JMESPath itself evaluates them."""

from typing import Any

import jmespath
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.specs.references import TooMuchWorkError, bounded_search

JOBS = {"drive": {"jobs": [{"arn": f"arn:{i}", "seed": i, "tags": {"room": "kitchen"}} for i in range(1000)]}}


def search(expression: str, scope: Any) -> Any:
    return bounded_search(jmespath.compile(expression).parsed, scope)


@pytest.mark.parametrize(
    "doubled",
    [
        "drive | " + " | ".join(["[@,@]"] * 40),
        "drive.jobs | " + " | ".join(["[@,@][]"] * 40),
        "drive | " + " | ".join(["{a: @, b: @}"] * 40),
        "drive.jobs[0].arn | " + " | ".join(["join('', [@,@])"] * 60),
        "to_string(drive | " + " | ".join(["[@,@]"] * 40) + ")",
        "drive.jobs[*].[" + "@,[".join([""] * 6) + "@" + "]" * 6 + " | " + " | ".join(["[@,@]"] * 20),
    ],
)
def test_what_doubles_ends_soon(doubled: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also sooner than it has to: as much as is allowed takes a second."""
    monkeypatch.setattr("prefect_robomaker.schemas.specs.references.MAX_WORK", 100_000)
    with pytest.raises(TooMuchWorkError):
        search(doubled, JOBS)


def test_a_thousand_jobs_are_read_in_full() -> None:
    assert search("drive.jobs[?seed > `10`].{name: arn, room: tags.room} | length(@)", JOBS) == 989
    assert len(search("drive.jobs[*].arn | sort(@) | join(',', @)", JOBS)) > 5000


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.text("ab", max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
    max_leaves=12,
)
EXPRESSIONS = [
    "a",
    "a.b",
    "a[*].b",
    "a[?b]",
    "[a, b]",
    "{x: a, y: c}",
    "a[]",
    "*.a",
    "length(a || `[]`)",
    "to_string(a)",
]


@given(st.sampled_from(EXPRESSIONS), st.dictionaries(st.sampled_from("abc"), VALUES, max_size=3))
def test_within_bounds_it_is_jmespath(expression: str, scope: dict[str, Any]) -> None:
    assert search(expression, scope) == jmespath.search(expression, scope)
