"""What the service refused in its last years."""

from typing import Any

import pytest

from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.schemas.wire.operation_shape import deprecated_uses


def job(**config: Any) -> dict[str, Any]:
    return {"simulationApplications": [{"application": "flat", "launchConfig": {}, **config}]}


def uses(operation: str, request: dict[str, Any]) -> list[str]:
    return [use.partition(":")[0] for use in deprecated_uses(OPERATIONS[operation], request)]


@pytest.mark.parametrize(
    ("operation", "request_", "places"),
    [
        ("CreateSimulationJob", job(useDefaultTools=True), ["simulationApplications[0].useDefaultTools"]),
        (
            "CreateSimulationJob",
            {**job(worldConfigs=[{"world": "arn:x"}]), "loggingConfig": {"recordAllRosTopics": True}},
            ["simulationApplications[0].worldConfigs", "loggingConfig.recordAllRosTopics"],
        ),
        (
            "StartSimulationJobBatch",
            {"createSimulationJobRequests": [job(), job(useDefaultUploadConfigurations=True)]},
            ["createSimulationJobRequests[1].simulationApplications[0].useDefaultUploadConfigurations"],
        ),
        (
            "CreateSimulationApplication",
            {
                "sources": [{"s3Bucket": "b"}],
                "robotSoftwareSuite": {"name": "ROS", "version": "Melodic"},
                "simulationSoftwareSuite": {"name": "Gazebo", "version": "9"},
            },
            ["sources", "robotSoftwareSuite.name", "simulationSoftwareSuite.name"],
        ),
        ("CreateRobotApplication", {"environment": {"uri": "x"}, "robotSoftwareSuite": {"name": "General"}}, []),
        ("CreateSimulationJob", job(useDefaultTools=False, worldConfigs=[], uploadConfigurations=[]), []),
        ("CreateSimulationJob", {**job(), "tags": {"useDefaultTools": "yes", "sources": "here"}}, []),
        ("CreateWorldTemplate", {"templateBody": {"sources": ["mine"]}}, []),
    ],
)
def test_members_are_named_by_their_place(operation: str, request_: dict[str, Any], places: list[str]) -> None:
    assert uses(operation, request_) == places


def test_the_operations_of_fleets_robots_and_deployments_are_refused_whatever_they_ask() -> None:
    refused = {name for name in OPERATIONS if deprecated_uses(OPERATIONS[name], {})}

    assert len(refused) == 15
    assert refused == {name for name in OPERATIONS if "Fleet" in name or "Robot" in name or "Deployment" in name} - {
        name for name in OPERATIONS if "RobotApplication" in name
    }
