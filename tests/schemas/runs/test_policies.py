"""Policies in requests."""

from typing import Any

import pytest
from helpers.variable_axes import variables

from prefect_robomaker.schemas.operations.simulation_jobs import SimulationJobRequest
from prefect_robomaker.schemas.runs.policies import POLICY_VARIABLE, parse_policy, policy_in

ROBOT = {"application": "mine", "launchConfig": {}}
SIMULATION = {"application": "arena", "launchConfig": {"packageName": "arena"}}


def request(**members: Any) -> SimulationJobRequest:
    """A checked request with a policy."""
    body = {"maxJobDurationInSeconds": 60, "simulationApplications": [SIMULATION], **members}
    return SimulationJobRequest.model_validate(body)


@pytest.mark.parametrize(
    ("policy", "file", "module", "attribute", "folders"),
    [
        ("nav.policies:act", None, "nav.policies", "act", "nav/policies"),
        ("nav:Policy.make", None, "nav", "Policy.make", "nav"),
        ("nav/walk.py:act", "nav/walk.py", None, "act", "nav"),
        ("nav/nets/walk.onnx", "nav/nets/walk.onnx", None, None, "nav/nets"),
        ("nav-1.0/walk.onnx", "nav-1.0/walk.onnx", None, None, "nav-1.0"),
        ("walk.onnx", "walk.onnx", None, None, ""),
        ("/opt/robomaker/datasources/nets/walk.onnx", "/opt/robomaker/datasources/nets/walk.onnx", None, None, ""),
    ],
)
def test_what_a_text_names(
    policy: str, file: str | None, module: str | None, attribute: str | None, folders: str
) -> None:
    found = parse_policy(policy)
    assert (found.file, found.module, found.attribute, "/".join(found.folders)) == (file, module, attribute, folders)


@pytest.mark.parametrize(
    "policy",
    [
        "",
        "walk",
        "walk.pt",
        "nav.policies",
        "nav:",
        ":act",
        "nav:a b",
        "../walk.onnx",
        "a/../b.py:act",
        "s3://x/w.onnx",
    ],
)
def test_what_is_no_policy_is_refused(policy: str) -> None:
    with pytest.raises(ValueError, match="policy"):
        request(policy=policy, robotApplications=[ROBOT])


def test_a_launch_variable_says_the_same() -> None:
    launch = {"environmentVariables": {POLICY_VARIABLE: "walk.onnx"}}
    checked = request(robotApplications=[{**ROBOT, "launchConfig": launch}])
    assert policy_in(checked.to_wire()) == "walk.onnx"
    assert policy_in(request(policy="nav:act").to_wire()) == "nav:act"
    assert policy_in(request().to_wire()) is None


@pytest.mark.parametrize(
    ("members", "said"),
    [
        ({"policy": "walk.onnx"}, "policy: walk.onnx is a file of the robot application, and the job has none; .*"
         "/opt/robomaker/datasources/policies/walk.onnx"),
        ({"policy": "nav:act", "robotApplications": [{**ROBOT, "launchConfig": {"command": ["drive"]}}]},
         r"policy and robotApplications\[0\].launchConfig.command both say what drives the robot"),
        ({"policy": "nav:act", "robotApplications": [{**ROBOT, "launchConfig": {"packageName": "nav"}}]},
         r"robotApplications\[0\].launchConfig.packageName both say"),
        ({"policy": "nav:act", "simulationApplications": [{**SIMULATION, "launchConfig": {"command": ["gazebo"]}}]},
         r"simulationApplications\[0\].launchConfig.command starts a program, which makes none"),
        ({"policy": "nav:act", "simulationApplications": [{**SIMULATION, "application": "recorded-run"}]},
         r"simulationApplications\[0\].application, recorded-run, judges a robot that has driven already"),
        ({"policy": "nav:act", "robotApplications": [
            {**ROBOT, "launchConfig": {"environmentVariables": {POLICY_VARIABLE: "nav:walk"}}}]},
         f"policy and .*{POLICY_VARIABLE} differ"),
        ({"robotApplications": [{**ROBOT, "launchConfig": {"environmentVariables": {POLICY_VARIABLE: "walk"}}}]},
         f"{POLICY_VARIABLE}: 'walk' is no policy; package.module:function"),
        ({"policy": "nav:act", "trials": {"seeds": 1, "axes": variables({POLICY_VARIABLE: ["a:b", "c:d"]})}},
         "a job has one policy; order a job for each"),
    ],
)  # fmt: skip
def test_a_policy_that_would_be_left_out_is_refused(members: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        request(**members)
