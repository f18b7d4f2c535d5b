"""What the steps of an ordered run may do: no more than the access key that ordered it."""

import json
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.endpoint.calling.audit_log import AuditLog
from prefect_robomaker.deployments.endpoint.protocol_errors import AccessDeniedException
from prefect_robomaker.deployments.spec_runs.rights import Permits, problems_of_rights
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.specification import CheckedSpec
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

SUBMIT = AccessKey("SUBMIT", "word", "submitter", "submit")
RED = AccessKey("RED", "word", "red", "administer", (), ("team=red",))
SOURCE = {"s3Bucket": "apps", "s3Key": "k", "architecture": "X86_64"}
SUITE = {"name": "ROS2", "version": "Foxy"}
FLEETS = {"operation": "ListFleets", "input": {}}


def spec(**steps: dict[str, Any]) -> CheckedSpec:
    return load_spec(json.dumps({"version": 1, "name": "one", "steps": steps}), "one.yaml")


def fleet(team: str) -> dict[str, Any]:
    return {"operation": "CreateFleet", "input": {"name": f"{team}-fleet", "tags": {"team": team}}}


def told(key: AccessKey | None, checked: CheckedSpec, service: Service) -> str:
    return "\n".join(map(str, problems_of_rights(key, checked, service.catalog)))


def test_steps_beyond_the_key_are_told_with_their_place_before_anything_runs(service: Service) -> None:
    both = spec(list=FLEETS, make=fleet("red"))
    assert "one.yaml:1:" in told(SUBMIT, both, service)
    assert "CreateFleet needs an access key with robomaker_scope = administer" in told(SUBMIT, both, service)
    assert told(None, both, service) == told(RED, both, service) == ""
    assert "a tag that begins with team=red" in told(RED, spec(make=fleet("blue")), service)


def test_an_application_that_the_run_makes_itself_may_be_used(service: Service) -> None:
    made = {"name": "red-robot", "sources": [SOURCE], "robotSoftwareSuite": SUITE, "tags": {"team": "red"}}
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "tags": {"team": "red"},
        "robotApplications": [{"application": "red-robot", "launchConfig": {}}],
    }
    drive = {"operation": "CreateSimulationJob", "input": request, "needs": ["robot"]}
    assert told(RED, spec(robot={"operation": "CreateRobotApplication", "input": made}, drive=drive), service) == ""
    assert "is not among the resources" in told(RED, spec(drive={**drive, "needs": []}), service)


@pytest.mark.parametrize("needs", [[], ["list"]])
def test_requests_for_each_entry_of_a_list_are_checked_where_they_are_known(service: Service, needs: list[str]) -> None:
    def batch(teams: list[str]) -> CheckedSpec:
        request = {"maxJobDurationInSeconds": 60, "iamRole": "arn:aws:iam::000000000000:role/test"}
        own = {"application": "red-robot", "launchConfig": {}}
        value = {**request, "robotApplications": [own], "tags": {"team": "${{ team }}"}}
        requests = {"forEach": teams, "as": "team", "value": value}
        start = {"tags": {"team": "red"}, "createSimulationJobRequests": requests}
        return spec(list=FLEETS, drive={"operation": "StartSimulationJobBatch", "input": start, "needs": needs})

    service.store.ensure_bucket("apps")
    service.store.put_bytes("apps", "k", b"archive")
    made = {"name": "red-robot", "sources": [SOURCE], "robotSoftwareSuite": SUITE, "tags": {"team": "red"}}
    call("CreateRobotApplication", made, service)
    assert told(RED, batch(["red", "red"]), service) == ""
    refused = told(RED, batch(["red", "blue"]), service)
    # What needs another step is checked when it runs.
    assert needs or "createSimulationJobRequests[1]" in refused


def test_each_step_is_decided_on_again_and_written_down(service: Service, tmp_path: Path) -> None:
    checked = spec(red=fleet("red"), blue=fleet("blue"), list=FLEETS)
    with AuditLog(tmp_path / "audit", service.clock) as audit_log:
        permits = Permits(RED, "10.0.0.7", audit_log, service)

        def ask(name: str) -> dict[str, Any]:
            step = checked.steps[name]
            request = fleet(name)["input"] if name != "list" else {}
            return permits(step, request, lambda: call(step.operation, request, service))

        assert ask("red")["name"] == "red-fleet"
        with pytest.raises(AccessDeniedException, match="team=red"):
            ask("blue")
        call("CreateFleet", fleet("blue")["input"], service)
        assert [each["name"] for each in ask("list")["fleetDetails"]] == ["red-fleet"]
    lines = [json.loads(line) for line in (tmp_path / "audit").read_text().splitlines()]
    assert [(each["caller"], each["address"], each["outcome"]) for each in lines] == [
        ("red", "10.0.0.7", "ok"),
        ("red", "10.0.0.7", "AccessDeniedException"),
        ("red", "10.0.0.7", "ok"),
    ]


def test_a_name_of_others_is_not_taken_over(service: Service) -> None:
    service.store.ensure_bucket("apps")
    service.store.put_bytes("apps", "k", b"archive")
    members = {"name": "robot", "sources": [SOURCE], "robotSoftwareSuite": SUITE}
    call("CreateRobotApplication", {**members, "tags": {"team": "blue"}}, service)
    own = {**members, "tags": {"team": "red"}}
    checked = spec(robot={"operation": "CreateRobotApplication", "input": own, "ifExists": "update"})
    with pytest.raises(AccessDeniedException, match="'robot' is not among"):
        Permits(RED, None, None, service)(checked.steps["robot"], own, dict)
