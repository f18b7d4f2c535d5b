"""`robomaker verify --trial` and `robomaker repro --trial`: what they print, and their exit codes."""

import json
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def home(service: Service) -> Path:
    """The data home of the service that jobs are run with."""
    return service.settings.home


def test_one_trial_is_verified_and_taken_apart(robomaker: Any, swing: Any, tmp_path: Path) -> None:
    job = swing(seed=3, job={"trials": {"seeds": 2}}, LIMIT="-1", TIME_LIMIT_S="2")

    shown = robomaker("verify", job["name"], "--trial", "1")
    assert (shown.code, shown.out, shown.err) == (0, "bit-identical: 3 states over 2.000 s\n", "")
    shown = robomaker("verify", job["name"], "--trial", "1", "-o", "json")
    assert json.loads(shown.out)["trial"] == 1

    shown = robomaker("repro", job["arn"], "--trial", "1", "--no-video", "--to", tmp_path / "repro")
    assert shown.out.startswith("The rerun ended with verdict FAIL (low), as the run did.\n")


def test_what_is_no_trial_is_said(robomaker: Any, swing: Any) -> None:
    job = swing(job={"trials": {"seeds": 2}}, TIME_LIMIT_S="0.1")
    shown = robomaker("verify", job["name"], "--trial", "one")
    assert shown.code == 2
    assert "'one' is no trial; its number, from 0, would be right" in shown.err
    shown = robomaker("verify", job["name"])
    assert shown.code == 2
    assert "has 2 trials; name one with --trial, from 0 to 1" in shown.err
