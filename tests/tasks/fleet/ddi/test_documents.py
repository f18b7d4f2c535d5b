import json
from dataclasses import replace

import pytest
from helpers.robot_orders import robot_order
from pydantic import ValidationError

from prefect_robomaker.schemas.fleet.operations.deployment_jobs import DeploymentLaunchConfig
from prefect_robomaker.tasks.fleet.ddi.open_orders import (
    LAUNCH_KEY,
    RobotState,
    base_document,
    cancel_document,
    order_document,
)

URL = "http://127.0.0.1:8057/DEFAULT/controller/v1/robot1"
IDLE = RobotState(bytes(32), wants_attributes=False)


def test_a_robot_without_order_is_told_when_to_poll() -> None:
    assert json.loads(base_document(URL, IDLE, 30)) == {"config": {"polling": {"sleep": "00:00:30"}}, "_links": {}}


@pytest.mark.parametrize(
    ("sleep_s", "text"), [(0, "00:00:01"), (90, "00:01:30"), (3600, "01:00:00"), (10**6, "23:59:59")]
)
def test_the_time_until_the_next_poll_is_that_of_a_clock(sleep_s: int, text: str) -> None:
    assert json.loads(base_document(URL, IDLE, sleep_s))["config"]["polling"]["sleep"] == text


def test_the_base_names_the_order_or_its_cancellation_never_both() -> None:
    offered = replace(IDLE, order=robot_order())

    assert json.loads(base_document(URL, offered, 1))["_links"] == {
        "deploymentBase": {"href": f"{URL}/deploymentBase/8"}
    }
    cancelled = replace(offered, is_cancelling=True)
    assert json.loads(base_document(URL, cancelled, 1))["_links"] == {"cancelAction": {"href": f"{URL}/cancelAction/8"}}


def test_a_robot_is_asked_what_it_is() -> None:
    links = json.loads(base_document(URL, replace(IDLE, wants_attributes=True), 30))["_links"]

    assert links == {"configData": {"href": f"{URL}/configData"}}


def test_an_order_is_what_swupdate_and_rauc_need() -> None:
    order = robot_order(b"content")

    document = json.loads(order_document(URL, order))

    link = {"href": f"{URL}/softwaremodules/8/artifacts/app.swu"}
    artifact = {
        "filename": "app.swu",
        "hashes": {"sha1": order.sha1, "md5": order.md5, "sha256": order.sha256},
        "size": 7,
        "_links": {"download": link, "download-http": link},
    }
    chunk = {"part": "bApp", "version": "3", "name": "app", "artifacts": [artifact]}
    assert document == {"id": "8", "deployment": {"download": "forced", "update": "forced", "chunks": [chunk]}}


def test_no_download_without_encryption_is_offered_behind_https() -> None:
    document = json.loads(order_document(URL.replace("http:", "https:"), robot_order()))

    assert set(document["deployment"]["chunks"][0]["artifacts"][0]["_links"]) == {"download"}


def test_what_to_launch_is_metadata_that_updaters_of_others_do_not_read() -> None:
    launch = DeploymentLaunchConfig(packageName="p", launchFile="l.py", environmentVariables={"A": 'b"'})

    (metadata,) = json.loads(order_document(URL, robot_order(launch=launch)))["deployment"]["chunks"][0]["metadata"]

    assert metadata["key"] == LAUNCH_KEY
    assert DeploymentLaunchConfig.model_validate_json(metadata["value"]) == launch


def test_a_cancellation_has_the_id_of_its_order() -> None:
    assert json.loads(cancel_document(11)) == {"id": "11", "cancelAction": {"stopId": "11"}}


@pytest.mark.parametrize(
    ("member", "value"),
    [
        ("action_id", 0),
        ("action_id", 2**31),
        ("action_id", "8"),
        ("robot", "a/b"),
        ("robot", ""),
        ("file_name", "../x.swu"),
        ("file_name", "a b.swu"),
        ("size_bytes", 0),
        ("sha256", "A" * 64),
        ("sha1", ""),
    ],
)
def test_orders_that_updaters_misunderstand_cannot_be_made(member: str, value: object) -> None:
    with pytest.raises(ValidationError, match=member):
        robot_order(**{member: value})
