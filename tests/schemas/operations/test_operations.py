"""Requests as clients send them, and what the parser says when they are wrong."""

import re
import subprocess
import sys
from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.operations.registry import (
    OPERATIONS,
    check_request,
    operation_shape,
    parse_request,
    seed_of,
    video_of,
)
from prefect_robomaker.schemas.operations.simulation_jobs import CreateSimulationJobRequest
from prefect_robomaker.schemas.wire.errors import InvalidParameterException

ROLE = "arn:aws:iam::111122223333:role/sim"
APP = "arn:aws:robomaker:us-east-1:111122223333:simulation-application/MyApp/1551203427605"


def job(**members: Any) -> dict[str, Any]:
    """The smallest request for a simulation job, changed; `...` leaves a member out."""
    smallest = {
        "maxJobDurationInSeconds": 300,
        "iamRole": ROLE,
        "simulationApplications": [{"application": APP, "launchConfig": {"packageName": "p", "launchFile": "l"}}],
    }
    return {name: value for name, value in {**smallest, **members}.items() if value is not ...}


def app(**members: Any) -> dict[str, Any]:
    return job(simulationApplications=[{"application": APP, "launchConfig": {}, **members}])


def complaint(operation: str, data: dict[str, Any]) -> str:
    with pytest.raises(InvalidParameterException) as caught:
        parse_request(operation, data)
    return str(caught.value)


def test_a_request_comes_back_as_it_was_sent() -> None:
    sent = job(
        clientRequestToken="t-1",
        outputLocation={"s3Bucket": "results", "s3Prefix": "nightly"},
        loggingConfig={"recordAllRosTopics": True},
        failureBehavior="Continue",
        dataSources=[{"name": "maps", "s3Bucket": "data", "s3Keys": ["a.zip"], "type": "Archive", "destination": "/m"}],
        tags={"team": "nav"},
        vpcConfig={"subnets": ["subnet-1", "subnet-1"], "securityGroups": ["sg-1"], "assignPublicIp": False},
        compute={"simulationUnitLimit": 15, "computeType": "GPU_AND_CPU", "gpuUnitLimit": 1},
        seed=7,
    )

    assert parse_request("CreateSimulationJob", sent).to_wire() == sent


def test_empty_parts_that_released_clients_send_are_accepted() -> None:
    application = {
        "application": APP,
        "launchConfig": {"command": ["run"], "portForwardingConfig": {"portMappings": []}},
        "tools": [],
        "uploadConfigurations": [],
    }
    sent = job(outputLocation={}, simulationApplications=[{**application, "worldConfigs": []}])

    request = parse_request("CreateSimulationJob", sent)

    assert "outputLocation" not in request.to_wire()
    assert request.to_wire()["simulationApplications"][0]["worldConfigs"] == []


def test_an_application_may_be_named_instead_of_its_arn() -> None:
    request = parse_request("CreateSimulationJob", app(application="indoor-navigation"))

    assert request.to_wire()["simulationApplications"][0]["application"] == "indoor-navigation"


def test_a_template_body_may_be_a_mapping() -> None:
    request = parse_request("CreateWorldTemplate", {"templateBody": {"Version": "2"}})

    assert request.to_wire() == {"templateBody": '{"Version": "2"}'}


def test_commands_may_have_several_lines() -> None:
    command = ["bash", "-c", "echo one\necho two"]

    assert parse_request("CreateSimulationJob", app(launchConfig={"command": command}))


@pytest.mark.parametrize(
    ("operation", "data", "expected"),
    [
        ("CreateSimulationJob", job(iamRole=...), "iamRole: is missing; it is required: ARN of the role"),
        (
            "CreateSimulationJob",
            job(iamRole="admin"),
            r"iamRole: is 'admin'; it has to be the ARN of a role, such as arn:aws:iam::",
        ),
        ("CreateSimulationJob", job(maxJobDurationInSeconds=0), "maxJobDurationInSeconds: is 0; .* at least 1"),
        ("CreateSimulationJob", job(maxJobDurationInSeconds=1209601), "it may be at most 1209600"),
        (
            "CreateSimulationJob",
            job(maxJobDurationInSeconds="5m"),
            "is '5m'; .* whole number of seconds, such as 300",
        ),
        ("CreateSimulationJob", job(maxJobDurationInSeconds=True), "is true; it has to be a whole number"),
        ("CreateSimulationJob", job(failureBehaviour="Fail"), "failureBehaviour: is not known; .* 'failureBehavior'"),
        ("CreateSimulationJob", job(failureBehavior="fail"), "is 'fail'; it has to be 'Fail' or 'Continue'"),
        ("CreateSimulationJob", job(simulationApplications=...), "at least one of robotApplications and simulat"),
        (
            "CreateSimulationJob",
            job(simulationApplications=[]),
            "simulationApplications: is .*length has to be at least 1",
        ),
        ("CreateSimulationJob", job(tags={"aws:x": "1"}), "tags: tag keys that begin with 'aws:' are reserved"),
        ("CreateSimulationJob", job(tags={"k": "ä"}), "tags.k: is 'ä'; it has to be of letters"),
        ("CreateSimulationJob", job(tags={"@": ""}), "tags.@: the key is '@'; it has to be of letters"),
        ("CreateSimulationJob", job(outputLocation={"s3Prefix": ""}), "outputLocation.s3Prefix: .* at least 1"),
        ("CreateSimulationJob", job(seed=-1), "seed: is -1; it has to be at least 0"),
        ("CreateSimulationJob", job(video="on"), "video: is 'on'; it has to be 'none', 'on-failure' or 'always'"),
        (
            "CreateSimulationJob",
            app(launchConfig={"comand": ["x"]}),
            r"simulationApplications\[0\].launchConfig.comand: is not known; did you mean 'command'\?",
        ),
        (
            "CreateSimulationJob",
            app(launchConfig={"environmentVariables": {"AWS_KEY": "x"}}),
            "launchConfig.environmentVariables: AWS variables other than those of SDKs are reserved; rename AWS_KEY",
        ),
        (
            "CreateSimulationJob",
            app(launchConfig={"environmentVariables": {"lower": "x"}}),
            "environmentVariables.lower: the key is 'lower'; it has to be of capital letters",
        ),
        (
            "CreateSimulationJob",
            app(launchConfig={"environmentVariables": {"E": ""}}),
            "Variables.E: is ''; its length has to be at least 1",
        ),
        ("CreateSimulationJob", app(launchConfig="run"), "launchConfig: is 'run'; it has to be a mapping"),
        ("CreateSimulationJob", app(launchConfig={"command": "run"}), "command: is 'run'; it has to be a list"),
        (
            "CreateSimulationJob",
            app(tools=[{"name": "top", "command": "top"}, {"name": "top", "command": "htop"}]),
            r"simulationApplications\[0\].tools: .*'top' appears more than once",
        ),
        (
            "CreateSimulationJob",
            app(uploadConfigurations=[{"name": "u", "path": "/var/log/*", "uploadBehavior": "UPLOAD_ON_TERMINATE"}]),
            "uploadConfigurations need an outputLocation",
        ),
        (
            "CreateSimulationJob",
            app(uploadConfigurations=[{"name": "u", "path": "/a/../b", "uploadBehavior": "UPLOAD_ON_TERMINATE"}]),
            "path: '/a/../b' must not lead upwards",
        ),
        (
            "CreateSimulationJob",
            job(dataSources=[{"name": "d", "s3Bucket": "abc", "s3Keys": ["a.rar"], "type": "Archive"}]),
            r"dataSources\[0\]: keys of type Archive have to end in .zip or .tar.gz; 'a.rar' does not",
        ),
        (
            "CreateSimulationJob",
            job(dataSources=[{"name": "d", "s3Bucket": "abc", "s3Keys": ["a"]}] * 2),
            "dataSources: .*'d' appears more than once",
        ),
        (
            "CreateWorldTemplate",
            {"templateBody": {"Version": datetime(2020, 1, 1, tzinfo=UTC)}},
            "templateBody: the mapping has no form in JSON: Object of type datetime",
        ),
        ("CreateWorldTemplate", {"templateBody": {"a": float("nan")}}, "the mapping has no form in JSON: "),
        ("CreateWorldTemplate", {}, "exactly one of templateBody and templateLocation .* neither is"),
        (
            "CreateWorldTemplate",
            {"templateBody": "{}", "templateLocation": {"s3Bucket": "abc", "s3Key": "k"}},
            "exactly one of templateBody and templateLocation .* both are",
        ),
        ("GetWorldTemplateBody", {}, "exactly one of template and generationJob .* neither is"),
        (
            "CreateWorldGenerationJob",
            {"template": "arn:t", "worldCount": {"floorplanCount": 2}},
            "worldCount: floorplanCount and interiorCountPerFloorplan both have to be given",
        ),
        (
            "CreateWorldGenerationJob",
            {"template": "arn:t", "worldCount": {"floorplanCount": 0, "interiorCountPerFloorplan": 1}},
            "worldCount.floorplanCount: is 0; it has to be at least 1",
        ),
        (
            "CreateRobotApplication",
            {"name": "r", "robotSoftwareSuite": {}},
            "exactly one of sources and environment has to be given, but neither is",
        ),
        (
            "CreateRobotApplication",
            {
                "name": "r",
                "robotSoftwareSuite": {},
                "environment": {"uri": "python://x"},
                "sources": [{"s3Bucket": "abc", "s3Key": "k"}],
            },
            "but both are",
        ),
        (
            "CreateRobotApplication",
            {"name": "r", "robotSoftwareSuite": {}, "sources": [{"s3Key": "k"}]},
            "sources: source 0 needs both s3Bucket and s3Key",
        ),
        (
            "StartSimulationJobBatch",
            {"createSimulationJobRequests": [job(), job(maxJobDurationInSeconds=...)]},
            r"createSimulationJobRequests\[1\].maxJobDurationInSeconds: is missing",
        ),
        (
            "StartSimulationJobBatch",
            {"createSimulationJobRequests": [job()], "batchPolicy": {"maxConcurrency": 0}},
            "batchPolicy.maxConcurrency: is 0; it has to be at least 1",
        ),
        ("ListWorlds", {"filters": [{"name": "status"}]}, r"filters\[0\]: a filter needs both name and values"),
        ("ListWorlds", {"maxResults": 101}, "maxResults: is 101; it may be at most 100"),
        ("DescribeFleet", {"fleet": "f"}, "it has to be an ARN: arn:aws:robomaker:<region>:<account>:<kind>/<id>$"),
        ("DescribeWorld", {"world": "arn:a\0"}, r"world: is 'arn:a\\x00'; it may not hold the character U\+0000"),
        ("BatchDeleteWorlds", {"worlds": ["arn:a", "arn:b\0"]}, r"worlds\[1\]: is 'arn:b\\x00'; it may not hold"),
        ("CreateWorldTemplate", {"templateBody": {"a\0": 1}}, "templateBody: a key holds the character U"),
    ],
)
def test_what_is_wrong_is_said_with_place_value_and_remedy(operation: str, data: dict[str, Any], expected: str) -> None:
    message = complaint(operation, data)

    assert re.search(expected, message), message
    assert message.startswith(f"{operation}: ")
    assert "\n" not in message


def test_every_problem_of_a_request_is_said_at_once() -> None:
    lines = complaint("CreateSimulationJob", job(iamRole=..., seed=-1, tools=[])).splitlines()

    assert len(lines) == 3


def test_problems_carry_the_place_they_are_at() -> None:
    [problem] = check_request("CreateSimulationJob", app(launchConfig={"streamUI": 1}))

    assert problem.location == ("simulationApplications", 0, "launchConfig", "streamUI")
    assert check_request("CreateSimulationJob", job()) == []
    assert [problem.path for problem in check_request("DescribeWorld", {"world": "arn:\0"})] == ["world"]


def test_an_unknown_operation_is_answered_with_the_nearest() -> None:
    assert "did you mean 'CreateSimulationJob'?" in complaint("createSimulationJob", {})
    assert "there are BatchDeleteWorlds, " in complaint("Fly", {})
    assert operation_shape("ListWorlds").path == "/listWorlds"


@pytest.mark.parametrize("name", OPERATIONS)
def test_every_member_is_described(name: str) -> None:
    def undescribed(schema: dict[str, Any]) -> list[str]:
        return [member for member, value in schema.get("properties", {}).items() if not value.get("description")]

    for model in (OPERATIONS[name].request, OPERATIONS[name].response):
        schema = model.model_json_schema()
        assert [undescribed(each) for each in (schema, *schema.get("$defs", {}).values()) if undescribed(each)] == []


def job_request(**members: Any) -> CreateSimulationJobRequest:
    request = parse_request("CreateSimulationJob", job(**members))
    assert isinstance(request, CreateSimulationJobRequest)
    return request


@pytest.mark.parametrize(
    ("members", "expected"),
    [
        ({}, None),
        ({"seed": 7}, 7),
        ({"tags": {"robomaker:seed": "11"}}, 11),
        ({"seed": 11, "tags": {"robomaker:seed": "11"}}, 11),
    ],
)
def test_a_seed_comes_from_its_member_or_its_tag(members: dict[str, Any], expected: int | None) -> None:
    assert seed_of(job_request(**members)) == expected


@pytest.mark.parametrize("tag", ["", "-1", "1.5", "seven", "０"])
def test_a_seed_tag_that_is_no_number_is_refused(tag: str) -> None:
    request = job_request()
    tagged = request.model_copy(update={"tags": {"robomaker:seed": tag}})

    with pytest.raises(InvalidParameterException, match="it has to be a whole number from 0"):
        seed_of(tagged)


def test_a_video_policy_comes_from_its_member_or_its_tag() -> None:
    def policy(**members: Any) -> str | None:
        return video_of(job_request(**members))

    assert policy() is None
    assert policy(video="none") == "none"
    assert policy(tags={"robomaker:video": "always"}) == "always"
    assert policy(video="on-failure", tags={"robomaker:video": "on-failure"}) == "on-failure"
    with pytest.raises(
        InvalidParameterException, match="is 'sometimes'; it has to be 'none', 'on-failure' or 'always'"
    ):
        policy(tags={"robomaker:video": "sometimes"})
    with pytest.raises(InvalidParameterException, match=r"video is 'none', but tags\.robomaker:video is 'always'"):
        policy(video="none", tags={"robomaker:video": "always"})


@given(st.text(max_size=8) | st.text("abc-_09", max_size=300))
def test_a_name_is_accepted_exactly_when_the_service_would(name: str) -> None:
    request = {"name": name, "robotSoftwareSuite": {"name": "General"}, "environment": {"uri": "python://x"}}

    accepted = not check_request("CreateRobotApplication", request)

    assert accepted == (re.fullmatch(r"[a-zA-Z0-9_\-]*", name) is not None and 1 <= len(name) <= 255)


_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(
    st.sampled_from(sorted(OPERATIONS)).flatmap(
        lambda name: st.tuples(
            st.just(name),
            st.dictionaries(st.sampled_from(sorted(OPERATIONS[name].request.model_fields)) | st.text(), _json),
        )
    )
)
def test_any_input_is_parsed_or_refused_with_a_place(case: tuple[str, dict[str, Any]]) -> None:
    name, data = case

    problems = check_request(name, data)

    assert all(problem.message for problem in problems)
    if not problems:
        assert set(parse_request(name, data).to_wire()) <= set(data)


def test_importing_the_operations_needs_neither_prefect_nor_a_database() -> None:
    program = "import sys, prefect_robomaker.schemas.operations.registry; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()

    assert not {"prefect", "sqlalchemy", "mujoco", "dm_control", "boto3", "numpy"} & set(loaded)
