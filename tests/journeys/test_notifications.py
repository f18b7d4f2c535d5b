"""Somebody is told: a real run fails, and the webhook has the failure, its picture and the line to run it again."""

import base64
import json
import platform
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest
from helpers.processes import wait_for
from helpers.receivers import Webhook
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.flows.pipelines import run_spec
from prefect_robomaker.schemas.reports.progress import Note, ProgressEvent
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.machine import machine_slots
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.notifications import notices
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.usefixtures("known_worlds")
Run = Callable[..., RunRecord]
COUNT = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
QUICK = {
    "template": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}},
    "list": {"operation": "ListWorlds", "needs": ["template"]},
}
MISSING = {"operation": "DescribeWorld", "input": {"world": "arn:aws:robomaker:us-east-1:000000000000:world/none"}}


def drive(limit_s: float) -> dict[str, Any]:
    job = {
        "maxJobDurationInSeconds": 120,
        "iamRole": ROLE,
        "seed": 3,
        "robotApplications": [{"application": "scout", "launchConfig": {}}],
        "simulationApplications": [
            {
                "application": "indoor-navigation",
                "launchConfig": {},
                "worldConfigs": [{"world": "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"}],
            }
        ],
        "requirements": [{"name": "be-quick", "kind": "time_limit", "limit_s": limit_s}],
    }
    generation = {"template": "${{ template.arn }}", "worldCount": COUNT, "seed": 7}
    return {
        "template": QUICK["template"],
        "worlds": {"operation": "CreateWorldGenerationJob", "input": generation},
        "job": {"operation": "CreateSimulationJob", "input": job},
    }


@pytest.fixture
def events() -> list[ProgressEvent]:
    return []


@pytest.fixture
def run(settings: Settings, webhook: Webhook, prefect_server: str, events: list[ProgressEvent]) -> Run:
    def start(steps: dict[str, Any], name: str = "nightly", **chosen: Any) -> RunRecord:
        checked = load_spec(json.dumps({"version": 1, "name": name, "steps": steps}), "nightly.yaml")
        told = settings.model_copy(update={"notify": (f"json://{webhook.address}/hook",), **chosen})
        return run_spec(WantedRun(checked, "nightly.yaml"), told, events.append)

    return start


@pytest.mark.deep
def test_a_verdict_that_fails_is_told_with_its_picture(run: Run, webhook: Webhook, service: Service) -> None:
    record = run(drive(limit_s=0.5), console_url="https://robots.example/console")

    assert record.state == "failed"
    (got,) = webhook.got
    assert got["title"] == "nightly: failed, 0 of 1 job passed, 1 failed"
    lines = got["message"].splitlines()
    assert lines[2].startswith(f"1. scout in flat 1 ({record.jobs[0].label}): be-quick: ")
    assert f"https://robots.example/console/jobs/{record.jobs[0].label}" in lines
    assert f"Run: https://robots.example/console/runs/{record.run_id}" in lines
    assert f"Report: {record.report_path} on {platform.node()}" in lines
    assert f"Run these again: robomaker rerun {record.run_id} --failed" in lines
    (picture,) = got["attachments"]
    assert base64.b64decode(picture["base64"]).startswith(b"\x89PNG")


def test_bad_nights_and_the_first_good_one_are_told(run: Run, webhook: Webhook) -> None:
    broken = {**QUICK, "list": MISSING}
    for steps in (QUICK, broken, QUICK, QUICK):
        run(steps)

    bad, good = (got["title"] for got in webhook.got)
    assert bad.startswith("nightly: broken, step list: ")
    assert good == "nightly: succeeded, good again"


def test_a_message_that_does_not_arrive_changes_no_run(run: Run, webhook: Webhook, events: list[ProgressEvent]) -> None:
    webhook.status = 503

    record = run(QUICK, notify_when=frozenset({"always"}))

    assert (record.state, record.exit_code) == ("succeeded", 0)
    (note,) = [event.text for event in events if isinstance(event, Note)]
    assert note.startswith("not notified: channel 1 of ROBOMAKER_NOTIFY, json://127.0.0.1")


@pytest.mark.deep
def test_nobody_is_told_unless_asked_and_apprise_is_not_loaded(run: Run, webhook: Webhook) -> None:
    run({**QUICK, "list": MISSING}, notify=())

    assert webhook.got == []
    code = "import sys; import prefect_robomaker.tasks.notifications.notices; print('apprise' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"


def test_an_address_is_called_when_a_night_begins_and_ends(
    run: Run, webhook: Webhook, events: list[ProgressEvent]
) -> None:
    chosen = {"notify": (), "ping_url": f"http://{webhook.address}/secret/{{name}}/"}
    good = run(QUICK, **chosen)
    wait_for(lambda: len(webhook.paths) == 2, "both calls")
    assert sorted(webhook.paths) == ["/secret/nightly/", "/secret/nightly/start"]
    assert {"text": f"{good.run_id}: succeeded"} in webhook.got

    webhook.status = 503
    assert run({"missing": MISSING}, name="every-hour", **chosen).state == "broken"
    wait_for(lambda: len(webhook.paths) == 4, "both calls")
    assert sorted(webhook.paths[2:]) == ["/secret/every-hour/fail", "/secret/every-hour/start"]
    notes = [event.text for event in events if isinstance(event, Note) and "ROBOMAKER_PING_URL" in event.text]
    assert notes == ["the address of ROBOMAKER_PING_URL was not told fail: status 503"]


@pytest.mark.deep
def test_a_night_that_waits_for_disk_is_told_of_while_it_waits(
    run: Run, settings: Settings, webhook: Webhook, events: list[ProgressEvent], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Notes of waits come each ten minutes; here the first one is late enough."""
    monkeypatch.setattr(notices, "AFTER_S", 0.0)
    monkeypatch.setattr(machine_slots, "_AGAIN_S", 1.0)
    batch = {
        "operation": "StartSimulationJobBatch",
        "input": {
            "batchPolicy": {"timeoutInSeconds": 20},
            "createSimulationJobRequests": [drive(100)["job"]["input"]],
        },
    }

    run({**drive(100), "job": batch}, min_free_disk_mb=9_999_999)

    told = [each for each in webhook.got if each["title"] == "nightly: waits for disk"]
    assert len(told) == 1
    assert "MB are free on the disk of ROBOMAKER_HOME, and a job begins with at least 9999999 MB" in told[0]["message"]
