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
    shown = robomaker("verify", job["name"], "--trial", "2")
    assert shown.code == 2
    assert robomaker("verify", job["name"]).out.startswith("trial 0: bit-identical"), "all of them passed"


def test_without_a_number_it_is_the_first_trial_that_did_not_pass(robomaker: Any, swing: Any, tmp_path: Path) -> None:
    """Reports print `robomaker repro JOB`, which has to run as it is printed."""
    axes = {"LIMIT": {"kind": "variable", "values": ["10", "-1"]}}
    job = swing(seed=3, job={"trials": {"seeds": 1, "axes": axes}}, TIME_LIMIT_S="0.2")
    shown = robomaker("verify", job["name"])
    assert (shown.code, shown.out.partition(":")[0]) == (0, "trial 1")
    shown = robomaker("repro", job["name"], "--no-video", "--to", tmp_path / "repro")
    assert shown.out.startswith("Trial 1 is repeated, as --trial names none: the first that did not pass, else 0.\n")
    assert "ended with verdict FAIL (low), as the run did" in shown.out
