"""References: what they give, and what is known of it beforehand."""

from datetime import UTC, datetime
from typing import Any

import jmespath
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.operations.world_generation_jobs import DescribeWorldGenerationJobResponse
from prefect_robomaker.schemas.specs.reference_typing import (
    ANYTHING,
    BOOLEAN,
    NUMBER,
    TEXT,
    WHOLE_NUMBER,
    Kind,
    ListOf,
    MapOf,
    Record,
    Structure,
    fits,
    infer,
    kind_of_value,
)
from prefect_robomaker.schemas.specs.references import ReferenceMistake, parse_template

KINDS: dict[str, Kind] = {"worlds": Structure(DescribeWorldGenerationJobResponse), "index": WHOLE_NUMBER}
VALUES: dict[str, Any] = {
    "worlds": {
        "arn": "arn:1",
        "createdAt": datetime(2026, 1, 2, tzinfo=UTC),
        "finishedWorldsSummary": {"succeededWorlds": ["arn:a", "arn:b"]},
    },
    "index": 3,
}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("plain", "plain"),
        ("", ""),
        ("${{ worlds.arn }}", "arn:1"),
        ("${{worlds.finishedWorldsSummary.succeededWorlds}}", ["arn:a", "arn:b"]),
        ("${{ index }}", 3),
        ("flat-${{ index }}/${{ worlds.arn }}", "flat-3/arn:1"),
        ("at ${{ worlds.createdAt }}", "at 2026-01-02T00:00:00+00:00"),
        ("$${{ index }}", "${{ index }}"),
        ("costs $5 {{ x }}", "costs $5 {{ x }}"),
        ("${{ {a: {b: index}} }}", {"a": {"b": 3}}),
        ("${{ '}}' }}", "}}"),
    ],
)
def test_values(text: str, value: object) -> None:
    assert parse_template(text).value(VALUES) == value


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("${{ worlds.arn }}", TEXT),
        ("${{ worlds.finishedWorldsSummary.succeededWorlds }}", ListOf(TEXT)),
        ("${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}", TEXT),
        ("${{ worlds.finishedWorldsSummary.succeededWorlds[:2] }}", ListOf(TEXT)),
        ("${{ worlds.finishedWorldsSummary.failureSummary.failures[*].failureCount }}", ListOf(WHOLE_NUMBER)),
        ("${{ worlds.finishedWorldsSummary.failureSummary.failures[?failureCount > `1`].failureCode }}", ListOf(TEXT)),
        ("${{ length(worlds.tags) }}", WHOLE_NUMBER),
        ("${{ worlds.tags.anything }}", TEXT),
        ("${{ worlds.tags }}", MapOf(TEXT)),
        ("${{ [worlds.arn, worlds.template] }}", ListOf(TEXT)),
        ("${{ worlds.arn || 'none' }}", TEXT),
        ("${{ to_string(index) }}", TEXT),
        ("${{ `1.5` }}", NUMBER),
        ("${{ index > `2` }}", BOOLEAN),
        ("${{ map(&failureCount, worlds.finishedWorldsSummary.failureSummary.failures) }}", ListOf(WHOLE_NUMBER)),
        ("flat-${{ index }}", TEXT),
    ],
)
def test_kinds(text: str, kind: Kind) -> None:
    assert parse_template(text).kind(KINDS) == kind


@pytest.mark.parametrize(
    ("text", "mistake"),
    [
        ("${{ wrlds.arn }}", "there is no step or variable 'wrlds'; did you mean 'worlds'?"),
        ("${{ @ }}", "there is no step or variable '@'"),
        ("${{ worlds.arm }}", "has no member 'arm'; did you mean 'arn'?"),
        ("${{ worlds.finishedWorldsSummary.succeededWorlds.arn }}", "choose entries with [0] or [*]"),
        ("${{ worlds.arn[0] }}", "[0] is asked of text, which is no list"),
        ("${{ worlds.arn[*] }}", "every entry is asked of text, which is no list"),
        ("${{ worlds.arn.* }}", ".* is asked of text, which is no mapping"),
        ("${{ lenght(worlds.tags) }}", "there is no function lenght(); did you mean 'length'?"),
        ("${{ length(index, index) }}", "length() takes 1 argument(s), not 2"),
        ("${{ sort_by(worlds.finishedWorldsSummary.failureSummary.failures, &count) }}", "has no member 'count'"),
        ("x ${{ worlds.tags }}", "only single values can stand inside text"),
        ("${{ my-step.arn }}", "not a JMESPath expression: Unknown token '-'"),
        ("${{ worlds.", "not closed with }}"),
        ("${{ }}", "not a JMESPath expression"),
        ("${{ " + "(" * 900 + "index" + ")" * 900 + " }}", "nested too deeply"),
        ("${{ " + "!" * 1900 + "index }}", "nested too deeply"),
        ("${{ '" + "x" * 5000 + "' }}", "not closed with }} within 2000 characters"),
    ],
)
def test_mistakes_are_found_before_anything_runs(text: str, mistake: str) -> None:
    with pytest.raises(ReferenceMistake) as caught:
        parse_template(text).kind(KINDS)
    assert mistake in str(caught.value)


@pytest.mark.parametrize("text", ["${{ worlds.failureReason }}", "a ${{ worlds.nothing }}", "${{ length(index) }}"])
def test_nothing_is_never_taken_for_a_value(text: str) -> None:
    with pytest.raises(ReferenceMistake):
        parse_template(text).value(VALUES)


def test_names_are_those_of_the_outermost_scope() -> None:
    text = "${{ a.b[?c == 'x'].d | [0] }} ${{ sort_by(e, &f) }} ${{ {g: h.i} }}"
    names = {name for reference in parse_template(text).references for name in reference.names()}
    assert names == {"a", "e", "h"}


_DOCUMENTS = st.fixed_dictionaries(
    {
        "text": st.text(max_size=3),
        "number": st.integers(),
        "list": st.lists(st.fixed_dictionaries({"a": st.integers(), "b": st.text(max_size=2)}), min_size=1, max_size=3),
        "nested": st.fixed_dictionaries(
            {"deep": st.lists(st.lists(st.integers(), min_size=1), min_size=1, max_size=2)}
        ),
    }
)
_EXPRESSIONS = [
    "list[*].a", "list[0].b", "list[?a > `0`].b", "nested.deep[]", "nested.deep[][]", "nested.*", "list[].a | [0]",
    "{x: text, y: list[0]}", "[number, number]", "length(list)", "keys(nested)", "max_by(list, &a).b",
    "sort(list[*].b)", "reverse(list)", "not_null(text, text)", "to_array(number)", "join(',', list[*].b)",
    "list[1:].a", "!text", "text == 'x' && number", "nested.deep[0] || list", "map(&b, list)",
    "merge(nested, nested)", "values(nested)",
]  # fmt: skip


@given(document=_DOCUMENTS, expression=st.sampled_from(_EXPRESSIONS))
def test_the_kind_foreseen_is_the_kind_found(document: dict[str, Any], expression: str) -> None:
    foreseen = infer(jmespath.compile(expression).parsed, kind_of_value(document))
    found = jmespath.search(expression, document)
    if found is not None:
        assert fits(kind_of_value(found), foreseen), (foreseen, found)


def test_what_fits_where() -> None:
    assert fits(NUMBER, WHOLE_NUMBER)
    assert fits(ANYTHING, ListOf(TEXT))
    assert fits(Record({"s3Bucket": TEXT}), Record({"s3Bucket": TEXT, "s3Prefix": TEXT}))
    assert not fits(Record({"other": TEXT}), Record({"s3Bucket": TEXT}))
    assert not fits(ListOf(TEXT), TEXT)
    assert not fits(TEXT, ListOf(TEXT))
    assert not fits(ListOf(WHOLE_NUMBER), ListOf(TEXT))
    assert not fits(BOOLEAN, WHOLE_NUMBER)
    assert not fits(Record({"a": WHOLE_NUMBER}), MapOf(TEXT))


def test_what_doubles_is_a_mistake_when_it_is_evaluated() -> None:
    template = parse_template("${{ worlds | " + " | ".join(["[@,@]"] * 40) + " }}")
    with pytest.raises(ReferenceMistake, match="it makes too much; use less of what it refers to"):
        template.value(VALUES)
