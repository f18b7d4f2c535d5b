"""The shared helpers of the shapes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from prefect_robomaker.schemas.operations.registry import parse_request
from prefect_robomaker.schemas.wire.common import (
    Filter,
    GenericString,
    exactly_one,
    filter_values,
    shorten,
    without_escapes,
)
from prefect_robomaker.schemas.wire.errors import InvalidParameterException


@given(st.text(min_size=1, max_size=50), st.integers(0, 200))
def test_a_shortened_reason_fits_and_keeps_both_ends(line: str, lines: int) -> None:
    reason = without_escapes(line * lines)
    short = shorten(line * lines)

    assert TypeAdapter(GenericString).validate_python(short) == short
    if len(reason) > 1024:
        assert len(short) == 1024
        assert short[:300] == reason[:300]
        assert short[-600:] == reason[-600:]
    else:
        assert short == reason


@pytest.mark.parametrize("given_values", [(None, None), (1, 2)])
def test_exactly_one_refuses_none_and_both(given_values: tuple[int | None, int | None]) -> None:
    with pytest.raises(ValueError, match="exactly one of a and b has to be given"):
        exactly_one(("a", "b"), given_values)


@pytest.mark.parametrize("name", ["\x1b]2;title\x07", "two\nlines", "nul\x00", "\x85"])
def test_a_control_character_in_a_name_is_refused_with_its_number(name: str) -> None:
    body = {"templateBody": {"Version": "2"}}
    for operation, members in (
        ("CreateWorldTemplate", body),
        ("UpdateWorldTemplate", {"template": "arn:aws:robomaker:us-west-2:000000000000:world-template/template-1"}),
    ):
        with pytest.raises(InvalidParameterException, match=r"name: .*control characters; remove U\+"):
            parse_request(operation, {**members, "name": name})
        parse_request(operation, {**members, "name": "Küche 🤖, 2. Stock"})


def test_filters_become_names_and_values() -> None:
    assert filter_values([Filter(name="status", values=["Active"])]) == {"status": ["Active"]}
    assert filter_values(None) == {}


def test_what_programs_say_to_terminals_is_no_reason() -> None:
    said = "\x1b]2;/home/me/a.launch\x07\x1b[31mRLException:\x1b[0m no\x1b]0;b\x1b\\ file\x00\n\tat all"
    assert shorten(said) == "RLException: no file\n\tat all"
