"""Habits of real programs that the service allowed: each is tried as those programs have it."""

import ipaddress
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.client_environments import run_client
from helpers.made_once import made_once

from .conftest import wanted_by

_SCRIPT = str(Path(__file__).parent / "habits_client.py")

pytestmark = pytest.mark.timeout(900)  # the first to come starts what is served
_QUICK = (
    "output_is_read_where_the_job_says_it_is",
    "failure_is_told_by_its_code_being_there",
    "tags_and_lists_of_batches_are_indexed",
    "names_stand_where_arns_belong",
    "running_jobs_have_an_address",
    "what_is_deleted_cannot_be_described",
    "existing_applications_are_updated",
    "tokens_are_made_of_the_second",
)
"""Those that make no world."""
_OF_WORLDS = ("export_is_found_by_the_id_in_its_jobs_arn", "template_bodies_are_wrapped")

Try = Callable[[str], Any]


@pytest.fixture
def habit(old_programs: Path, place: Any, tmp_path_factory: pytest.TempPathFactory) -> Try:
    """What came of a habit. One program has all quick ones, once in a test run; another has those about worlds."""

    def run(name: str) -> Any:
        group, habits = ("quick", _QUICK) if name in _QUICK else ("worlds", _OF_WORLDS)

        def have(folder: Path) -> None:
            folder.mkdir()
            command = [str(old_programs / "python"), _SCRIPT, *habits]
            environ = {**place.environ, "HOME": str(folder)}
            said = run_client(command, environ, json.dumps(wanted_by(f"habits-{group}")))
            (folder / "told.json").write_text(said)

        told = made_once(tmp_path_factory, f"habits-{group}", have) / "told.json"
        ended = json.loads(told.read_text())[name]
        assert "failed" not in ended, ended["failed"]
        return ended["found"]

    return run


@pytest.mark.deep
def test_an_export_is_found_by_the_id_in_its_jobs_arn(habit: Try, place: Any) -> None:
    told = habit("export_is_found_by_the_id_in_its_jobs_arn")

    assert told["worlds"] == 1
    assert told["etag"]
    assert told["key"].startswith("arn:aws:robomaker:us-east-1:000000000000:world-generation-job/generation-")
    assert zipfile.is_zipfile(place.objects / "results" / told["key"])


def test_output_is_read_where_the_job_says_it_is(habit: Try, place: Any) -> None:
    told = habit("output_is_read_where_the_job_says_it_is")

    assert told["launched"] == "make_environment"
    assert list((place.objects / told["place"]).glob("sim-*/*/result.json"))


def test_a_failure_is_told_by_its_code_being_there(habit: Try) -> None:
    told = habit("failure_is_told_by_its_code_being_there")

    assert told["code"] == "SimulationApplicationCrash"
    assert "the simulated floor gave way" in told["reason"]


@pytest.mark.deep
def test_tags_and_lists_of_batches_are_indexed(habit: Try) -> None:
    told = habit("tags_and_lists_of_batches_are_indexed")

    assert told["atFirst"] == 2
    assert told["atLast"] == [1, 0, 1]
    assert told["failed"] in ("InvalidInput", "ResourceNotFound")
    assert told["tags"] == [[]]


def test_names_stand_where_arns_belong(habit: Try) -> None:
    assert habit("names_stand_where_arns_belong") == {"same": True, "asGiven": True, "listed": [True, False]}


def test_running_jobs_have_an_address(habit: Try) -> None:
    for address in habit("running_jobs_have_an_address"):
        assert ipaddress.ip_address(address)


def test_what_is_deleted_cannot_be_described(habit: Try) -> None:
    assert habit("what_is_deleted_cannot_be_described") == "ResourceNotFoundException"


def test_existing_applications_are_updated(habit: Try) -> None:
    assert habit("existing_applications_are_updated") == {"revisions": 2, "version": "1"}


def test_tokens_are_made_of_the_second(habit: Try) -> None:
    assert habit("tokens_are_made_of_the_second") == 1


@pytest.mark.deep
def test_template_bodies_are_wrapped(habit: Try) -> None:
    assert habit("template_bodies_are_wrapped") == ["Completed", None]
