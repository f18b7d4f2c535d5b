"""Applications and templates of probes and challenges are gone afterwards, also if their process was killed."""

import json
import subprocess
import sys
from contextlib import suppress

import pytest
from helpers.cartpole_spec import poles

from prefect_robomaker.flows.pipelines import PipelineRun
from prefect_robomaker.schemas.reports.progress import ProgressEvent, StepEnded, StepStarted
from prefect_robomaker.tasks.nights.cut_runs import remove_left, removing_made
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

SUITE = {"name": "General"}
KILLED = """
import os, signal, sys
from prefect_robomaker.schemas.reports.progress import StepEnded, StepStarted
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.nights.cut_runs import removing_made
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

service = Service.open(Settings.from_environment(os.environ))
with removing_made(service, lambda event: None) as heard:
    heard(StepStarted("agent", "CreateRobotApplication"))
    request = {"name": "agent", "environment": {"uri": "python://agent"}, "robotSoftwareSuite": {"name": "General"}}
    heard(StepEnded("agent", "Completed", 0.1, call("CreateRobotApplication", request, service)["arn"]))
    print("made", flush=True)
    if sys.argv[1] == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    sys.stdin.read()
"""


def create(name: str, service: Service) -> str:
    request = {"name": name, "environment": {"uri": f"python://{name}"}, "robotSoftwareSuite": SUITE}
    return call("CreateRobotApplication", request, service)["arn"]


def applications(service: Service) -> list[str]:
    found = call("ListRobotApplications", {}, service)["robotApplicationSummaries"]
    return [each["name"] for each in found if each["name"] in ("agent", "before")]


def test_only_what_the_run_created_is_deleted_and_events_are_passed_on(service: Service) -> None:
    before = create("before", service)
    told: list[ProgressEvent] = []
    with suppress(KeyboardInterrupt), removing_made(service, told.append) as heard:
        for step, name in (("first", "before"), ("second", "agent")):
            heard(StepStarted(step, "CreateRobotApplication"))
            heard(StepEnded(step, "Completed", 0.1, before if name == "before" else create(name, service)))
        heard(StepStarted("third", "CreateRobotApplication"))
        heard(StepEnded("third", "Failed", 0.1, "the name is taken"))
        assert applications(service) == ["agent", "before"]
        raise KeyboardInterrupt

    assert applications(service) == ["before"], "`ifExists: reuse` took it over"
    assert len(told) == 6
    assert list((service.settings.home / "cut-runs").iterdir()) == []


@pytest.mark.deep
def test_the_next_run_deletes_what_a_killed_one_left_and_nothing_of_one_that_lives(service: Service) -> None:
    home = {"ROBOMAKER_HOME": str(service.settings.home)}
    command = [sys.executable, "-c", KILLED]
    subprocess.run([*command, "killed"], env=home, check=False, stdout=subprocess.DEVNULL)
    assert applications(service) == ["agent"]
    remove_left(service)
    assert applications(service) == []

    with subprocess.Popen([*command, "lives"], env=home, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as living:
        assert living.stdout is not None
        assert living.stdin is not None
        assert living.stdout.readline() == b"made\n"
        remove_left(service)
        assert applications(service) == ["agent"], "its process lives"
        living.stdin.close()
    assert applications(service) == [], "it deleted that itself"


def test_a_deployed_night_takes_over_nothing_that_a_killed_challenge_left(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = service.settings.home / "cut-runs"
    folder.mkdir()
    note = '{"operation": "CreateRobotApplication", "arn": "%s", "began": "2000-01-01T00:00:00+00:00"}\n'
    (folder / "a.jsonl").write_text(note % create("agent", service))
    monkeypatch.setenv("ROBOMAKER_HOME", str(service.settings.home))

    PipelineRun.of_parameters(None, poles("seed: 1"), "poles.yaml")

    assert applications(service) == []


def test_a_line_that_was_not_written_whole_hides_no_other(service: Service) -> None:
    folder = service.settings.home / "cut-runs"
    folder.mkdir()
    note = '{"operation": "CreateRobotApplication", "arn": "%s", "began": "2000-01-01T00:00:00+00:00"}\n'
    (folder / "a.jsonl").write_text(note % create("agent", service) + '{"operation": "Create')

    remove_left(service)

    assert applications(service) == []
    assert list(folder.iterdir()) == []


def test_what_cannot_be_deleted_is_told_and_no_reason_to_run_nothing(
    service: Service, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    folder = service.settings.home / "cut-runs"
    folder.mkdir(parents=True)
    note = {
        "operation": "CreateRobotApplication",
        "arn": create("agent", service),
        "began": "2020-01-01T00:00:00+00:00",
    }
    (folder / "left.jsonl").write_text(json.dumps(note) + "\n")

    def refuse(*_: object) -> None:
        raise PermissionError("not yours")

    monkeypatch.setattr("prefect_robomaker.tasks.nights.cut_runs.call", refuse)
    remove_left(service)
    assert "left.jsonl: not yours" in caplog.text
    assert (folder / "left.jsonl").exists()
