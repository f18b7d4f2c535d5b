"""Specifications that vary worlds, before they run."""

import re

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import SpecError

PAGE = (REPOSITORY / "docs" / "world-import.md").read_text()
EXAMPLE = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[-1]


@pytest.mark.parametrize(
    ("written", "wrong", "expected"),
    [
        ("{light: night}", "{}", r"variations\[0\].*nothing would differ; say one of shut"),
        ("{light: night}", "{light: dusk}", r"variations\[0\]\.light.*day.*evening"),
        ("{light: night}", "{lamp: on}", r"variations\[0\]\.lamp"),
        ("door-1: 40", "door-1: 140", r"variations\[2\]\.open.*100"),
        ("[Living/Bed]", "[Living/Bed], open: {Living/Bed: 3}", r"'Living/Bed' is to be shut and to be open"),
        ("remove: [Sofas_1]", "move: {Sofas_1: [1]}", r"variations\[2\]\.move\.Sofas_1"),
        ("variations.worlds", "variations.arns", r"VaryWorldsResponse has no member 'arns'"),
    ],
)
def test_mistakes_are_found_before_anything_runs(written: str, wrong: str, expected: str) -> None:
    assert written in EXAMPLE
    with pytest.raises(SpecError, match=expected):
        load_spec(EXAMPLE.replace(written, wrong), "robustness.yaml")


def test_plans_count_variations(robomaker, tmp_path) -> None:
    spec = tmp_path / "robustness.yaml"
    spec.write_text(EXAMPLE)
    ended = robomaker("plan", spec)
    assert "3 worlds: 3 variations of 1 world" in ended.out
    assert "4 simulation jobs" in ended.out
