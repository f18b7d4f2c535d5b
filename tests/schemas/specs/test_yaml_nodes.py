"""Reading YAML with places."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.specs.yaml_nodes import MAX_BYTES, MAX_DEPTH, key_place, parse, plain, value_place
from prefect_robomaker.schemas.wire.errors import SpecError
from prefect_robomaker.schemas.wire.request_problems import path_text

_json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"], exclude_characters="\ufeff\ufffe\uffff")),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text("abcdef <:#-'\"", max_size=6), inner, max_size=4)
    ),
    max_leaves=20,
)


@given(_json_values, st.booleans())
def test_json_is_read_as_json(value: object, ensure_ascii: bool) -> None:
    assert plain(parse(json.dumps(value, ensure_ascii=ensure_ascii), "f")) == value


def test_pairs_of_surrogate_escapes_are_one_character() -> None:
    assert plain(parse(r'{"\ud83e\udd16": "a\ud83d\ude00b"}', "f")) == {"🤖": "a😀b"}


def test_scalars_are_those_of_yaml_1_2() -> None:
    text = "[no, yes, on, 010, 0o10, 0x1F, 1e3, .5, 1_000, 2020-01-01, ~, null, '1', True, 12:30, arn:aws:x]"
    expected = [
        "no",
        "yes",
        "on",
        10,
        8,
        31,
        1000.0,
        0.5,
        "1_000",
        "2020-01-01",
        None,
        None,
        "1",
        True,
        "12:30",
        "arn:aws:x",
    ]
    assert plain(parse(text, "f")) == expected


def test_places_count_from_one_and_tell_keys_from_values() -> None:
    root = parse("first: 1\nsecond:\n  - third: {fourth: deep}\n", "spec.yaml")
    location = ("second", 0, "third", "fourth")
    assert str(key_place(root, location)) == "spec.yaml:3:13"
    assert str(value_place(root, location)) == "spec.yaml:3:21"
    assert path_text(location) == "second[0].third.fourth"


def test_a_missing_value_stands_at_the_key_that_should_hold_it() -> None:
    root = parse("first: 1\nsecond:\n  inner: 2\n", "spec.yaml")
    assert str(value_place(root, ("second", "missing"))) == "spec.yaml:2:1"
    assert str(value_place(root, ("second", "missing", "deeper"))) == "spec.yaml:2:1"


def test_an_alias_stands_for_its_anchor() -> None:
    assert plain(parse("a: &it {x: 1}\nb: [*it, *it]", "f")) == {"a": {"x": 1}, "b": [{"x": 1}, {"x": 1}]}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "f:1:1: the file is empty"),
        ("# only a comment\n", "f:1:1: the file is empty"),
        ("a: 1\nb: 2\na: 3\n", "f:3:1: 'a' is there twice; the first is at line 1"),
        ("a: !danger x", "f:1:4: tags such as !danger are not allowed"),
        (
            "a: !!python/object:os.system x",
            "f:1:4: tags such as tag:yaml.org,2002:python/object:os.system are not allowed",
        ),
        ("<<: {a: 1}", "f:1:1: merge keys"),
        ("a: *nothing", "f:1:4: there is no anchor &nothing before this alias"),
        ("a: &a [*a]", "f:1:8: there is no anchor &a before this alias"),
        ("a: 1\n---\nb: 2", "f:3:1: a file holds one document"),
        ("a: .nan", "f:1:4: .nan is not a number that JSON has"),
        ("a: -.inf", "f:1:4: -.inf is not a number that JSON has"),
        ("a: 1e999", "f:1:4: 1e999 is not a number that JSON has"),
        ("[1, 2]: x", "f:1:1: a key has to be plain text"),
        ("a: {{ b }}", "f:1:5: a key has to be plain text; a reference is written ${{ … }}, with the dollar"),
        ("a:\n\tb: 1", "f:2:1: this is not YAML"),
        ("a: 'open", "this is not YAML"),
        ("a: {\n", "f:2:1: this is not YAML"),
        ("a: \x01", "this is not YAML"),
        (r'{"a": "\ud83d"}', "f:1:7: holds half of a surrogate pair"),
        (r'{"\ude00": 1}', "f:1:2: holds half of a surrogate pair"),
        ("[" * (MAX_DEPTH + 5), "nested more than"),
        ("[" * 50_000, "nested more than"),
        ("9" * 100_000, "is not a number that JSON has"),
        ("a" * (MAX_BYTES + 1), "f:1:1: the file is larger than 1024 KiB"),
    ],
)
def test_refused_texts_say_where_and_why(text: str, problem: str) -> None:
    with pytest.raises(SpecError) as caught:
        parse(text, "f")
    assert problem in str(caught.value)
    assert len(str(caught.value)) < 300


def test_aliases_cannot_multiply_without_bound() -> None:
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    with pytest.raises(SpecError, match="more than 100000 values, aliases counted in full"):
        parse("\n".join(levels), "f")


def test_a_value_that_is_not_there_is_placed_at_its_key() -> None:
    root = parse("steps:\n  x:\n\n  # more\n  a: {b: , c: 1}\n", "spec.yaml")

    places = [value_place(root, location) for location in (("steps", "x"), ("steps", "a", "b"))]
    assert [(place.line, place.column) for place in places] == [(2, 3), (5, 7)]
