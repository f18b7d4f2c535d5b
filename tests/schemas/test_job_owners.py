"""Who carries out a job, and what somebody else has otherwise: comparisons and words."""

from datetime import UTC, datetime
from typing import Any

import pytest

from prefect_robomaker.schemas.job_owners import JobOwner, JobStanding, NeededEnvironment

ARN = "arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1"
NEEDED = NeededEnvironment(
    machine="lab", python="/venv", python_path=("/my robot", "/lib"), variables={"ROBOMAKER_NICE": "3", "M": ""},
    packages={"robot": "abc"},
)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "owner", "words"),
    [
        ("lab:7:1a:robomaker run", ("robomaker run", "lab", 7), "robomaker run (process 7 on lab)"),
        ("lab:7:1a", ("a job worker", "lab", 7), "a job worker (process 7 on lab)"),
        ("gc:1a", ("a job worker", "gc", None), "a job worker (on gc)"),
    ],
)
def test_the_name_of_a_lease_says_who_it_is(name: str, owner: Any, words: str) -> None:
    found = JobOwner.of_lease(name)

    assert (found.program, found.machine, found.process_id) == owner
    assert str(found) == words


@pytest.mark.parametrize(
    ("changes", "differences"),
    [
        ({}, []),
        ({"machine": "attic", "python": "/other"}, []),
        ({"python_path": ("/lib",)}, ["PYTHONPATH is /lib, not /my robot:/lib"]),
        ({"python_path": ()}, ["PYTHONPATH is not set, not /my robot:/lib"]),
        ({"variables": {"ROBOMAKER_NICE": "0", "M": ""}}, ["ROBOMAKER_NICE is 0, not 3"]),
        ({"variables": {"ROBOMAKER_NICE": "3", "M": "/m"}}, ["M is /m, not unset"]),
        ({"variables": {"ROBOMAKER_NICE": "3"}}, []),
        ({"packages": {"robot": "abd"}}, ["package robot has other files"]),
        ({"packages": {}}, ["package robot is not installed"]),
    ],
)
def test_differences_are_told(changes: dict[str, Any], differences: list[str]) -> None:
    assert NEEDED.differences(NEEDED.model_copy(update=changes)) == differences


def test_an_import_path_that_the_job_does_not_need_is_no_difference() -> None:
    needed = NEEDED.model_copy(update={"python_path": None})

    assert needed.differences(NEEDED) == []
    assert needed.command(ARN) == f"ROBOMAKER_NICE=3 /venv/bin/robomaker perform {ARN}"


def test_the_command_has_what_the_other_process_lacks_and_no_more() -> None:
    here = NEEDED.model_copy(update={"python_path": (), "variables": {"ROBOMAKER_NICE": "0", "M": "x"}})

    assert NEEDED.command(ARN, NEEDED) == f"robomaker perform {ARN}"
    assert NEEDED.command(ARN, here) == f"PYTHONPATH='/my robot:/lib' ROBOMAKER_NICE=3 M='' robomaker perform {ARN}"
    elsewhere = f"PYTHONPATH='/my robot:/lib' ROBOMAKER_NICE=3 /venv/bin/robomaker perform {ARN}"
    assert NEEDED.command(ARN) == elsewhere


@pytest.mark.parametrize(
    ("state", "differences", "words"),
    [
        ("works", (), ""),
        ("ended", ("A is 1, not 2",), ""),
        ("died", (), ", which has died; the next job worker takes it"),
        (
            "left",
            ("A is 1, not 2",),
            ", which has left it; job workers with another environment leave it: A is 1, not 2",
        ),
    ],
)
def test_a_standing_in_words(state: Any, differences: tuple[str, ...], words: str) -> None:
    owner = JobOwner(program="robomaker run", machine="lab", process_id=7)
    since = datetime(2026, 11, 28, 2, 0, 5, tzinfo=UTC)
    lost = JobOwner(program="robomaker serve", machine="lab", process_id=6)
    standing = JobStanding(owner=owner, since=since, state=state, lost=lost, differences=differences, command="go")

    told = "carried out by robomaker run (process 7 on lab) since 2026-11-28 02:00:05 UTC"
    assert standing.in_words() == f"{told}, as robomaker serve (process 6 on lab) had died{words}"
    assert standing.waits_for_command == (state == "left")
