"""What is wrong with a request is told in words, and only as much of it as helps."""

from typing import Any

import pytest

from prefect_robomaker.schemas.operations.registry import check_request
from prefect_robomaker.schemas.wire.request_problems import MAX_PROBLEMS, nearest_ones

UNKNOWN = {f"u{i}": 1 for i in range(5000)}


def test_of_many_problems_the_first_are_told_and_the_rest_counted() -> None:
    problems = check_request("CreateFleet", {"name": "yard", **UNKNOWN})
    assert len(problems) == MAX_PROBLEMS + 1
    assert str(problems[0]) == "u0: is not known; known are name, tags"
    assert str(problems[-1]) == f"{5000 - MAX_PROBLEMS} more problems are not listed"


def test_of_as_many_problems_as_are_told_none_is_missing() -> None:
    unknown = dict(list(UNKNOWN.items())[:MAX_PROBLEMS])
    assert [problem.path for problem in check_request("CreateFleet", {"name": "yard", **unknown})] == list(unknown)


def test_no_words_are_looked_for_when_everything_is_wrong() -> None:
    (problem,) = check_request("CreateFleet", {f"u{i}": 1 for i in range(20_000)})
    assert str(problem) == "has 20001 problems, too many to look for words for any of them"


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ({f"k{i}": 1 for i in range(100_000)}, "is a mapping with k0, k1, k2"),
        ([1] * 100_000, "is a list of 100000; it has to be text"),
        (["a", "b"], "is ['a', 'b']; it has to be text"),
        ([], "is an empty list; it has to be text"),
        ([{}], "is a list of 1; it has to be text"),
    ],
)
def test_large_values_are_shown_by_their_beginning(value: Any, shown: str) -> None:
    (problem,) = check_request("CreateFleet", {"name": value})
    assert shown in str(problem)
    assert len(str(problem)) < 200


def test_words_about_as_similar_as_the_nearest_one_are_told_with_it() -> None:
    assert nearest_ones("world", ["worlds", "wrld", "template"]) == "; did you mean 'worlds' or 'wrld'?"
    assert nearest_ones("templat", ["worlds", "template"]) == "; did you mean 'template'?"
    assert nearest_ones("x", ["worlds"]) == nearest_ones("x", []) == ""
