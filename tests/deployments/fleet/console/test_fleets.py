"""Pages of fleets, robots, deployments and applications."""

import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from helpers.deployed_robots import Yard, bad, deployable, good

from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.tasks.fleet.fleet_records import DEPLOYMENT
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

HALF = {"concurrentDeploymentPercentage": 50, "failureThresholdPercentage": 60}
RED = AccessKey("RED", "word", "red", "read", (), ("team=red",))


@pytest.fixture
def yard(service: Service) -> Yard:
    """A fleet of two robots, of which one fails, and the deployment to it, which has ended."""
    yard = Yard(service)
    yard.robot("rover-1", good)
    yard.robot("rover-2", bad)
    return yard


@pytest.fixture
def deployment(yard: Yard) -> str:
    arn = yard.fleets.deploy(yard.arn, deployable(yard.fleets, "X86_64"), "once", deploymentConfig=HALF)["arn"]
    yard.run(arn)
    return arn.rpartition("/")[2]


def links(page: str) -> set[str]:
    found = re.findall(r'href="(/console/[^"#]*)"', page)
    return {link for link in found if "/assets/" not in link}


def test_a_fleet_leads_to_its_robots_and_deployments(browser: Any, yard: Yard, deployment: str) -> None:
    listed = browser.get("/console/fleets").text
    [fleet] = [link for link in links(listed) if link.startswith("/console/fleets/")]
    page = browser.get(fleet).text
    robots = [link for link in links(page) if link.startswith("/console/robots/")]

    assert f"/console/deployments/{deployment}" in listed
    assert f"/console/deployments/{deployment}" in page
    assert [word in page for word in ("rover-1", "rover-2", "InSync", "RobotAgentConnectionTimeout")][:3] == [True] * 3
    assert len(robots) == 2
    for robot in robots:
        answer = browser.get(robot)
        assert (answer.status_code, fleet in answer.text, deployment in answer.text) == (200, True, True)
    assert {link for link in links(browser.get("/console/robots").text) if "robots/" in link} == set(robots)


def test_a_deployment_is_shown_as_waves(browser: Any, deployment: str) -> None:
    page = browser.get(f"/console/deployments/{deployment}").text

    assert "Wave 1" in page
    assert "Why robots failed" in page
    assert page.count('class="row') >= 2
    assert "style=" not in page


def test_a_deployment_that_goes_on_is_followed(browser: Any, yard: Yard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("prefect_robomaker.deployments.fleet.console.pages._EVERY_S", 0.01)
    arn = yard.fleets.deploy(yard.arn, deployable(yard.fleets, "X86_64"), "once", deploymentConfig=HALF)["arn"]
    address = f"/console/deployments/{arn.rpartition('/')[2]}"
    assert f'data-follow="{address}/live"' in browser.get(address).text
    get_many, looks = yard.service.catalog.get_many, iter(range(2))

    def cancel_at_the_third_look(*words: Any) -> Any:
        if arn in words[0] and next(looks, None) is None:
            yard.fleets.cancel(arn)
        return get_many(*words)

    monkeypatch.setattr(yard.service.catalog, "get_many", cancel_at_the_third_look)
    stream = browser.get(f"{address}/live").text
    parts = [json.loads(line.removeprefix("data: ")) for line in stream.split("\n") if line.startswith("data: {")]

    assert "Canceled" in parts[-1]["rollout"]
    assert "Canceled" not in parts[0]["rollout"]
    assert "event: end" in stream


def test_an_application_shows_its_versions(browser: Any, yard: Yard, deployment: str) -> None:
    listed = browser.get("/console/applications").text
    mine = next(link for link in links(listed) if "/robot-application/mine/" in link)
    page = browser.get(mine).text

    assert "scout" in listed
    assert re.search(r'<th scope="row">1</th>', page)
    assert "s3://" in page
    assert "No job has used it." in page
    assert browser.get("/console/applications/world/mine").status_code == 404


def test_a_fleet_leads_to_no_deployment_that_is_not_the_visitors(
    visitor: Callable[..., Any], yard: Yard, deployment: str
) -> None:
    client = visitor(RED)
    client.post("/console/login", data={"key": RED.id, "secret": RED.secret, "to": "/console"})
    call("TagResource", {"resourceArn": yard.arn, "tags": {"team": "red"}}, yard.service)
    page = client.get("/console/fleets").text

    assert ("yard" in page, deployment in page) == (True, False)
    [job] = yard.service.catalog.list(DEPLOYMENT).resources
    call("TagResource", {"resourceArn": job.arn, "tags": {"team": "red"}}, yard.service)
    assert deployment in client.get("/console/fleets").text


def test_a_confined_key_sees_only_its_own_fleets(visitor: Callable[..., Any], yard: Yard, deployment: str) -> None:
    client = visitor(RED)
    client.post("/console/login", data={"key": RED.id, "secret": RED.secret, "to": "/console"})
    own = yard.fleets.fleet("dock", tags={"team": "red"})
    yard.fleets.robot("hidden-one", own)
    yard.fleets.robot("shown-one", own, tags={"team": "red"})
    page = client.get("/console/fleets").text
    [fleet] = [link for link in links(page) if link.startswith("/console/fleets/")]

    assert "yard" not in page
    assert ("shown-one" in client.get(fleet).text, "hidden-one" in client.get(fleet).text) == (True, False)
    for path in (f"/deployments/{deployment}", f"/fleets/{yard.arn.partition('fleet/')[2]}"):
        assert client.get(f"/console{path}").status_code == 404
