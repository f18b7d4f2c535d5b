"""The program keeps what the record of 1.0.0 promises, and the record has all that there is to promise."""

import json
from functools import partial
from pathlib import Path

import pytest

from tools.promises import __main__ as command
from tools.promises.records import HINT, broken_promises, path_of, record, recorded, unrecorded
from tools.promises.surfaces import SURFACES


def test_no_promise_is_broken() -> None:
    assert list(broken_promises()) == []


def test_what_was_added_is_recorded() -> None:
    assert list(unrecorded()) == [], HINT


@pytest.mark.parametrize("surface", SURFACES)
def test_each_surface_is_recorded(surface: str) -> None:
    assert len(recorded(surface)) > 20


def test_the_record_names_what_users_know() -> None:
    assert "CreateSimulationJobRequest.maxJobDurationInSeconds" in recorded("wire-requests")
    assert "DescribeSimulationJobResponse.status" in recorded("wire-responses")
    assert "ListSimulationJobs has pages" in recorded("wire-operations")
    assert {"Step.operation", "WorldTemplateBody.Buildings", "VaryWorldsRequest.worlds"} <= set(
        recorded("specification")
    )
    assert {"results.outcome", "trials.margin.REQUIREMENT"} <= set(recorded("results"))
    assert {"run.(spec)", "Run.jobs", "ConfigurationError is RobomakerError"} <= set(recorded("python"))
    assert {"ROBOMAKER_HOME", "ROBOMAKER_ROBOT_POLL_S", "ROBOMAKER_DEBUG"} <= set(recorded("settings"))
    assert {"catalog.resources.arn", "SimulationJobDocument.request", "RunRecord.jobs"} <= set(recorded("homes"))


@pytest.fixture
def older(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A record that promises a setting that is gone, and knows one of today's not."""
    record(tmp_path)
    path = path_of("settings", tmp_path)
    facts = json.loads(path.read_text())
    facts["ROBOMAKER_GONE"] = facts.pop("ROBOMAKER_NICE")
    path.write_text(json.dumps(facts))
    for use in (broken_promises, unrecorded, record):
        monkeypatch.setattr(command, use.__name__, partial(use, tmp_path))
    return tmp_path


def test_before_the_release_the_record_may_be_made_anew(older: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([]) == 1
    assert "settings: ROBOMAKER_GONE is gone; keep it" in capsys.readouterr().err
    assert command.main(["--record"]) == 0
    assert command.main([]) == 0
    assert path_of("settings", older).read_text() == path_of("settings").read_text()


def test_from_the_release_on_only_additions_are_recorded(
    older: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "version", lambda _: "1.0.0")
    before = path_of("settings", older).read_text()

    assert command.main(["--record"]) == 1
    assert path_of("settings", older).read_text() == before

    facts = json.loads(before)
    del facts["ROBOMAKER_GONE"]
    path_of("settings", older).write_text(json.dumps(facts))
    assert command.main([]) == 1
    assert "settings: ROBOMAKER_NICE\n" in capsys.readouterr().out
    assert command.main(["--record"]) == 0
    assert "ROBOMAKER_NICE" in path_of("settings", older).read_text()
