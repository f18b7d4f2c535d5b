"""Requests broken at random: refused with the service's own errors, and a refusal changes nothing."""

import copy
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import pytest
from helpers.examples import examples
from helpers.small_flat import BODY, ROLE
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from sqlalchemy import create_engine, func, select

from prefect_robomaker.schemas.wire.errors import ServiceError
from prefect_robomaker.tasks.catalog.tables import metadata
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

ARN = "arn:aws:robomaker:us-east-1:000000000000"
JOB: dict[str, Any] = {
    "maxJobDurationInSeconds": 60,
    "iamRole": ROLE,
    "outputLocation": {"s3Bucket": "results", "s3Prefix": "a/b"},
    "failureBehavior": "Fail",
    "robotApplications": [{"application": "scout", "applicationVersion": "$LATEST", "launchConfig": {}}],
    "simulationApplications": [
        {
            "application": "indoor-navigation",
            "launchConfig": {"environmentVariables": {"A": "b"}, "streamUI": False},
            "worldConfigs": [{"world": f"{ARN}:world/nowhere"}],
        }
    ],
    "dataSources": [{"name": "maps", "s3Bucket": "robomaker", "s3Keys": ["none"], "type": "File"}],
    "tags": {"robomaker:seed": "7"},
    "seed": 7,
    "video": "none",
}
APPLICATION = {
    "name": "mine",
    "robotSoftwareSuite": {"name": "General"},
    "environment": {"uri": "python://package.module"},
    "tags": {"a": "b"},
}
NAMED = {"name": "name", "values": ["mine"]}
FLEET, ROBOT = f"{ARN}:deployment-fleet/none/1", f"{ARN}:robot/none/1"
DEPLOYED = {
    "application": f"{ARN}:robot-application/none/1",
    "applicationVersion": "1",
    "launchConfig": {
        "packageName": "p",
        "launchFile": "l",
        "preLaunchFile": "a.sh",
        "environmentVariables": {"A": "b"},
    },
}
DEPLOYMENT_CONFIG = {
    "concurrentDeploymentPercentage": 20,
    "failureThresholdPercentage": 30,
    "robotDeploymentTimeoutInSeconds": 60,
    "downloadConditionFile": {"bucket": "robomaker", "key": "none", "etag": "e"},
}
REGISTRATION = {"fleet": FLEET, "robot": ROBOT}
FLEET_REQUESTS: dict[str, dict[str, Any]] = {
    "CreateFleet": {"name": "yard", "tags": {"a": "b"}},
    "DescribeFleet": {"fleet": FLEET},
    "ListFleets": {"maxResults": 200, "nextToken": "abc", "filters": [NAMED]},
    "DeleteFleet": {"fleet": FLEET},
    "CreateRobot": {"name": "rover", "architecture": "ARMHF", "greengrassGroupId": "g", "tags": {"a": "b"}},
    "DescribeRobot": {"robot": ROBOT},
    "ListRobots": {"maxResults": 3, "nextToken": "abc", "filters": [{**NAMED, "name": "fleetName"}]},
    "DeleteRobot": {"robot": ROBOT},
    "RegisterRobot": REGISTRATION,
    "DeregisterRobot": REGISTRATION,
    "CreateDeploymentJob": {
        "deploymentConfig": DEPLOYMENT_CONFIG,
        "clientRequestToken": "t",
        "fleet": FLEET,
        "deploymentApplicationConfigs": [DEPLOYED],
        "tags": {"a": "b"},
    },
    "SyncDeploymentJob": {"clientRequestToken": "t", "fleet": FLEET},
    "DescribeDeploymentJob": {"job": f"{ARN}:deployment-job/none"},
    "ListDeploymentJobs": {"maxResults": 3, "nextToken": "abc", "filters": [{**NAMED, "name": "status"}]},
    "CancelDeploymentJob": {"job": f"{ARN}:deployment-job/none"},
    "ListTagsForResource": {"resourceArn": FLEET},
    "TagResource": {"resourceArn": FLEET, "tags": {"a": "b", "c": ""}},
    "UntagResource": {"resourceArn": FLEET, "tagKeys": ["a", "c"]},
}
REQUESTS: dict[str, dict[str, Any]] = {
    **FLEET_REQUESTS,
    "CreateWorldTemplate": {"clientRequestToken": "t", "name": "flat", "templateBody": BODY, "tags": {"a": "b"}},
    "CreateWorldGenerationJob": {
        "template": f"{ARN}:world-template/none",
        "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 2},
        "seed": 1,
        "worldTags": {"a": "b"},
    },
    "CreateWorldExportJob": {
        "worlds": [f"{ARN}:world/none"],
        "outputLocation": {"s3Bucket": "results", "s3Prefix": "x"},
        "iamRole": ROLE,
    },
    "CreateRobotApplication": APPLICATION,
    "CreateSimulationApplication": {
        **APPLICATION,
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
        "sources": [{"s3Bucket": "robomaker", "s3Key": "none.tar.gz", "architecture": "X86_64"}],
    },
    "CreateSimulationJob": JOB,
    "StartSimulationJobBatch": {
        "clientRequestToken": "t",
        "batchPolicy": {"timeoutInSeconds": 60, "maxConcurrency": 2},
        "createSimulationJobRequests": [JOB],
        "tags": {"a": "b"},
    },
    "BatchDescribeSimulationJob": {"jobs": [f"{ARN}:simulation-job/none"]},
    "ListWorlds": {"maxResults": 3, "nextToken": "abc", "filters": [{"name": "status", "values": ["Active"]}]},
    "DescribeWorld": {"world": f"{ARN}:world/none"},
    "DescribeWorldTemplate": {"template": f"{ARN}:world-template/none"},
    "GetWorldTemplateBody": {"template": f"{ARN}:world-template/n", "generationJob": f"{ARN}:world-generation-job/x"},
    "DescribeWorldGenerationJob": {"job": f"{ARN}:world-generation-job/none"},
    "DescribeWorldExportJob": {"job": f"{ARN}:world-export-job/none"},
    "UpdateWorldTemplate": {"template": f"{ARN}:world-template/none", "name": "flat", "templateBody": BODY},
    "ListWorldTemplates": {"maxResults": 3, "nextToken": "abc"},
    "DeleteWorldTemplate": {"template": f"{ARN}:world-template/none"},
    "ListWorldGenerationJobs": {"maxResults": 3, "filters": [{**NAMED, "name": "templateId"}]},
    "CancelWorldGenerationJob": {"job": f"{ARN}:world-generation-job/none"},
    "BatchDeleteWorlds": {"worlds": [f"{ARN}:world/none"]},
    "ListWorldExportJobs": {"maxResults": 3, "filters": [{**NAMED, "name": "generationJobId"}]},
    "CancelWorldExportJob": {"job": f"{ARN}:world-export-job/none"},
    "DescribeSimulationJob": {"job": f"{ARN}:simulation-job/none"},
    "ListSimulationJobs": {"maxResults": 3, "filters": [{**NAMED, "name": "simulationApplicationName"}]},
    "CancelSimulationJob": {"job": f"{ARN}:simulation-job/none"},
    "RestartSimulationJob": {"job": f"{ARN}:simulation-job/none"},
    "DescribeSimulationJobBatch": {"batch": f"{ARN}:simulation-job-batch/none"},
    "ListSimulationJobBatches": {"maxResults": 3, "nextToken": "abc", "filters": [{**NAMED, "name": "status"}]},
    "CancelSimulationJobBatch": {"batch": f"{ARN}:simulation-job-batch/none"},
    **{
        name: request
        for role in ("Robot", "Simulation")
        for name, request in {
            f"Create{role}ApplicationVersion": {
                "application": "mine",
                "currentRevisionId": "none",
                "s3Etags": ["x"],
                "imageDigest": "sha256:" + 64 * "0",
            },
            f"Describe{role}Application": {
                "application": f"{ARN}:{role.lower()}-application/x/1",
                "applicationVersion": "1",
            },
            f"List{role}Applications": {"versionQualifier": "ALL", "maxResults": 3, "filters": [NAMED]},
            f"Update{role}Application": {
                **{member: value for member, value in APPLICATION.items() if member not in ("name", "tags")},
                **({"simulationSoftwareSuite": {"name": "Gazebo", "version": "7"}} if role == "Simulation" else {}),
                "application": "scout",
                "currentRevisionId": "none",
            },
            f"Delete{role}Application": {"application": "mine", "applicationVersion": "1"},
        }.items()
    },
}  # fmt: skip

NASTY = st.sampled_from(
    [
        None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**400, 0.5, float("nan"), float("inf"), -0.0,
        "", " ", "\0", "\ud800", "é" * 300, "x" * 2000, "../../etc/passwd", "/", "arn:", "arn:\n", "${{ a.b }}", "{}",
        "'; DROP TABLE resources; --", "%s%n", "\u202e", "0", "$LATEST", b"bytes", [], [[]], [None], {}, {"": ""},
        {"a": {"b": {}}}, ["x"] * 2000, {str(index): "x" for index in range(200)}, ("a",), {1: 2}, object(), 1 + 2j,
    ]
)  # fmt: skip
ANYTHING = st.one_of(
    NASTY,
    st.text(max_size=20),
    st.integers(),
    st.floats(),
    st.recursive(
        st.one_of(st.none(), st.booleans(), st.integers(), st.text(max_size=5)),
        lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=3)),
        max_leaves=6,
    ),
)


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of everything inside a request."""
    steps = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path] * bool(path) + [found for key, inner in steps for found in places(inner, (*path, key))]


def mutate(request: Mapping[str, Any], data: st.DataObject) -> dict[str, Any]:
    """The request with one to three things changed, removed, added or doubled."""
    broken = copy.deepcopy(dict(request))
    for _ in range(data.draw(st.integers(1, 3), "mutations")):
        there = places(broken)
        if not there:
            break
        *way, last = data.draw(st.sampled_from(there), "place")
        holder: Any = broken
        for step in way:
            holder = holder[step]
        match data.draw(st.sampled_from(("replace", "replace", "remove", "rename", "double")), "how"):
            case "remove":
                del holder[last]
            case "rename" if isinstance(holder, dict):
                holder[data.draw(st.text(max_size=8), "name")] = holder.pop(last)
            case "double" if isinstance(holder, list):
                holder.append(copy.deepcopy(holder[last]))
            case _:
                holder[last] = copy.deepcopy(data.draw(ANYTHING, "value"))
    return broken


@pytest.fixture(scope="module")
def empty_service(tmp_path_factory: pytest.TempPathFactory) -> Service:
    """One service for all requests; what some of them create does no harm to the others."""
    from prefect_robomaker.schemas.settings import Settings

    home = tmp_path_factory.mktemp("fuzzed") / "home"
    return Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(home)}), {})


@pytest.fixture(scope="module")
def count_rows(empty_service: Service) -> Iterator[Callable[[], dict[str, int]]]:
    """Counts the rows of every table of the catalog."""
    engine = create_engine(empty_service.settings.catalog_url)

    def count() -> dict[str, int]:
        with engine.connect() as connection:
            return {
                table.name: connection.scalar(select(func.count()).select_from(table)) or 0
                for table in metadata.sorted_tables
            }

    yield count
    engine.dispose()


def test_every_operation_is_fuzzed() -> None:
    assert REQUESTS.keys() == registry().keys()


@examples(500, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(operation=st.sampled_from(sorted(REQUESTS)), data=st.data())
def test_broken_requests_are_refused_with_the_services_errors_and_change_nothing(
    operation: str, empty_service: Service, count_rows: Callable[[], dict[str, int]], data: st.DataObject
) -> None:
    request = mutate(REQUESTS[operation], data)
    before = count_rows()
    objects = sorted(empty_service.settings.home.rglob("*"))

    refused: ServiceError | None = None
    try:
        call(operation, request, empty_service)
    except ServiceError as error:
        refused = error
    if refused is not None:
        assert str(refused).strip()
        assert type(refused) in registry()[operation].shape.errors
        assert count_rows() == before
        assert sorted(empty_service.settings.home.rglob("*")) == objects


@examples(60)
@given(name=st.text(max_size=30), request=ANYTHING)
def test_any_operation_with_any_request(empty_service: Service, name: str, request: Any) -> None:
    with pytest.raises(ServiceError):
        call(name, request, empty_service)
