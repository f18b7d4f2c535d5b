"""Events about worlds and reports: read from Prefect's API, as its page *Event Feed* does."""

from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for
from prefect import flow

from prefect_robomaker.tasks.execution.prefect_events import tell_of_report, tell_of_world

WORLD = "arn:aws:robomaker:us-east-1:000000000000:world/generation-{name}/world-1"


@pytest.mark.slow
def test_events_reach_the_server_with_the_flow_run_that_they_are_about(prefect_server: str, tmp_path: Path) -> None:
    name = tmp_path.name  # which no other run of this test has
    arn = WORLD.format(name=name)

    @flow(name="makes things")
    def makes() -> None:
        tell_of_world(arn, "s3://robomaker/worlds/1", "arn:template")
        tell_of_report(f"{name}-1", "failed", Path("/data/report.html"), {"PASS": 3, "FAIL": 1})

    state: Any = makes(return_state=True)

    world = event_of(f"robomaker.world.generation-{name}/world-1")
    report = event_of(f"robomaker.report.{name}-1")
    assert world["event"] == "robomaker.world.generated"
    assert world["resource"]["robomaker.arn"] == arn
    assert world["payload"] == {"uri": "s3://robomaker/worlds/1", "template": "arn:template"}
    assert report["event"] == "robomaker.report.written"
    assert report["resource"]["robomaker.state"] == "failed"
    assert report["payload"] == {"path": "/data/report.html", "verdicts": {"PASS": 3, "FAIL": 1}}
    run = f"prefect.flow-run.{state.state_details.flow_run_id}"
    assert run in {related["prefect.resource.id"] for related in world["related"]}


def test_no_event_is_sent_outside_a_flow_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("prefect.events.emit_event", lambda **_: pytest.fail("there is no flow run"))

    tell_of_world(WORLD.format(name="x"), "s3://robomaker/worlds/1", "arn:template")


def event_of(resource_id: str) -> dict[str, Any]:
    """The event about a resource, once the server has it."""
    from prefect.client.orchestration import get_client

    wanted = {"filter": {"any_resource": {"id": [resource_id]}}}
    with get_client(sync_client=True) as client:

        def found() -> list[dict[str, Any]]:
            return client.request("POST", "/events/filter", json=wanted).json()["events"]

        return wait_for(found, f"the event of {resource_id}")[0]
