"""The rules by which a later fact keeps an earlier one."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tools.promises.facts import Fact, additions, breaks, read, written

TYPES = st.frozensets(st.sampled_from(["string", "integer", "null", "Goal", "Path", '"on"', '"off"', "1", "true"]))
LIMITS = st.none() | st.integers(-5, 5) | st.floats(-5, 5)
FACTS = st.builds(
    Fact,
    form=st.none() | st.text(),
    taken=st.none() | TYPES,
    given=st.none() | TYPES,
    required=st.booleans(),
    default=st.none() | st.text(),
    place=st.none() | st.integers(0, 9),
    above=LIMITS,
    least=LIMITS,
    below=LIMITS,
    most=LIMITS,
    pattern=st.none() | st.text(),
    version=st.none() | st.integers(1, 9),
)
SURFACES = st.dictionaries(st.text(), FACTS, max_size=5)


def taken(*types: str, **more: Any) -> Fact:
    return Fact(taken=frozenset(types), **more)


def given_back(*types: str, **more: Any) -> Fact:
    return Fact(given=frozenset(types), **more)


@given(SURFACES)
def test_what_is_written_is_read_and_keeps_itself(facts: Mapping[str, Fact]) -> None:
    assert read(written(facts)) == facts
    assert breaks(facts, facts) == []
    assert additions(facts, facts) == []


@given(SURFACES, st.data())
def test_nothing_goes_without_a_sentence_that_names_it(facts: Mapping[str, Fact], data: st.DataObject) -> None:
    if facts:
        gone = data.draw(st.sampled_from(sorted(facts)))
        left = {name: fact for name, fact in facts.items() if name != gone}

        assert any(problem.startswith(f"{gone} is gone; keep it") for problem in breaks(facts, left))


REFUSED = {
    "another type": (taken("string"), taken("integer"), "takes string no more"),
    "a type less": (taken("string", "integer"), taken("integer"), "takes string no more"),
    "a value less": (taken('"on"', '"off"'), taken('"on"'), 'takes "off" no more'),
    "values in place of all": (taken("string"), taken('"on"'), "takes string no more"),
    "it became required": (taken("string"), taken("string", required=True), "became required; leave it optional"),
    "another default": (taken("integer", default="3"), taken("integer", default="4"), "had the default 3 and has 4"),
    "a default less": (taken("integer", default="3"), taken("integer"), "had the default 3 and has none"),
    "a default where there was none": (taken("integer"), taken("integer", default="3"), "had the default none"),
    "a larger least": (taken("integer", least=1), taken("integer", least=2), "begins at 2 and began at 1"),
    "a least where there was none": (taken("integer"), taken("integer", least=2), "begins at 2 and began at nothing"),
    "one number less": (taken("number", least=0), taken("number", above=0), "begins at what is beyond 0"),
    "a smaller most": (taken("string", most=9), taken("string", most=8), "ends at 8 and ended at 9"),
    "one number less above": (taken("number", most=9), taken("number", below=9), "ends at what is beyond 9"),
    "another pattern": (taken("string", pattern="a"), taken("string", pattern="b"), "has the pattern b and had a"),
    "another place": (taken("str", place=1), taken("str", place=2), "was parameter 1 and is 2"),
    "by name only": (taken("str", place=1), taken("str"), "was parameter 1 and is none"),
    "another type given": (given_back("string"), given_back("integer"), "gives integer, which callers do not know"),
    "nothing given at times": (given_back("str"), given_back("str", "NoneType"), "gives NoneType, which callers"),
    "a value less given": (given_back('"on"', '"off"'), given_back('"on"'), 'gives "off" no more'),
    "any text given": (given_back('"on"'), given_back("string"), "gives string, which callers do not know"),
    "it may be absent": (given_back("str", required=True), given_back("str"), "may be absent now"),
    "given and not taken": (taken("string"), given_back("string"), "is taken where it was given, or the other way"),
    "another form": (Fact(form="POST /a"), Fact(form="POST /b"), "was POST /a and is POST /b"),
    "an older version": (Fact(version=2), Fact(version=1), "had version 2 and has 1"),
}
ALLOWED = {
    "a type more": (taken("string"), taken("string", "integer")),
    "a value more": (taken('"on"'), taken('"on"', '"off"')),
    "all in place of values": (taken('"on"'), taken("string")),
    "all numbers": (taken("integer"), taken("number")),
    "it became optional": (taken("string", required=True), taken("string", default="a")),
    "a smaller least": (taken("integer", least=2), taken("integer", least=1)),
    "no most any more": (taken("integer", most=2), taken("integer")),
    "no pattern any more": (taken("string", pattern="a"), taken("string")),
    "also by place": (taken("str"), taken("str", place=3)),
    "a value more given": (given_back('"on"'), given_back('"on"', '"off"')),
    "a type less given": (given_back("str", "NoneType"), given_back("str")),
    "values of the type given": (given_back("string"), given_back('"on"')),
    "a shape more among shapes": (given_back("Goal", "Path"), given_back("Goal", "Path", "Speed")),
    "always given": (given_back("str"), given_back("str", required=True)),
}


@pytest.mark.parametrize(("old", "new", "sentence"), REFUSED.values(), ids=REFUSED)
def test_a_break_is_told(old: Fact, new: Fact, sentence: str) -> None:
    problems = breaks({"Shape.member": old}, {"Shape.member": new})

    assert all(problem.startswith("Shape.member ") for problem in problems)
    assert any(sentence in problem for problem in problems)


@pytest.mark.parametrize(("old", "new"), ALLOWED.values(), ids=ALLOWED)
def test_what_takes_nothing_away_is_allowed_and_to_be_recorded(old: Fact, new: Fact) -> None:
    assert breaks({"Shape.member": old}, {"Shape.member": new}) == []
    assert additions({"Shape.member": old}, {"Shape.member": new}) == ["Shape.member"]


def test_a_new_member_is_optional_where_its_shape_was_there() -> None:
    old = {"Shape.member": taken("string")}
    new = {**old, "Shape.more": taken("string", required=True), "New.more": taken("string", required=True)}

    assert breaks(old, new) == [
        "Shape.more is new and required; give it a default, so that who knows it not is served as before"
    ]
    assert breaks(old, {**new, "Shape.more": taken("string")}) == []
    assert additions(old, new) == ["New.more", "Shape.more"]


def test_a_function_without_parameters_gets_none_that_is_required() -> None:
    old = {"run": Fact(form="function")}

    assert len(breaks(old, {**old, "run.(spec)": taken("str", required=True)})) == 1


def test_a_form_with_a_newer_version_is_left_to_its_migration() -> None:
    old = {"catalog": Fact(version=8), "catalog.jobs.arn": taken("VARCHAR"), "Job.arn": taken("string")}
    new = {"catalog": replace(old["catalog"], version=9)}

    assert breaks(old, new) == ["Job.arn is gone; keep it, deprecated at most, until 2.0.0"]
