"""Programs that some tests need: where they may be missing a test is skipped, where they may not it fails."""

import os
from typing import NoReturn

import pytest

VARIABLE = "ROBOMAKER_TESTS_REQUIRE"
"""Names the programs that are there for sure, such as `chromium docker ros`: `.ci/run` sets it to what it installed."""


def is_required(program: str) -> bool:
    """Whether a test may not be skipped for want of a program."""
    return program in os.environ.get(VARIABLE, "").split()


def missing(program: str, reason: str) -> NoReturn:
    """Skips the test that runs, or fails it where the program has to be there."""
    if is_required(program):
        pytest.fail(f"{reason}; {VARIABLE} says that {program} is there")
    pytest.skip(reason)


def needs(program: str, found: object, reason: str) -> pytest.MarkDecorator:
    """Marks tests that are skipped where `found` is false; where the program has to be there they run, and fail."""
    return pytest.mark.skipif(not found and not is_required(program), reason=reason)
