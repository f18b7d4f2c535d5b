"""call, against a real catalog and object store."""

import io
import json
import os
import re
import socket
import time
from dataclasses import replace

import pytest
from ruamel.yaml import YAML

from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.tasks.execution.leases.held_leases import HeldLeases
from prefect_robomaker.tasks.jobs.job_owners import OwnOrder
from prefect_robomaker.tasks.machine.slot_files import WaiterFiles, WaiterRecord
from prefect_robomaker.tasks.operations.registry import registry
from prefect_robomaker.tasks.service.service import Service

BODY = {"name": "two rooms", "templateBody": '{"Version": "1"}'}


@pytest.fixture
def template(robomaker) -> str:
    return json.loads(robomaker("call", "CreateWorldTemplate", "--input", json.dumps(BODY)).out)["arn"]


def test_a_response_is_json_or_yaml(robomaker, template: str) -> None:
    request = json.dumps({"template": template})
    answer = json.loads(robomaker("call", "DescribeWorldTemplate", "--input", request).out)
    assert answer["name"] == "two rooms"
    assert answer["createdAt"].endswith("+00:00")
    shown = robomaker("call", "describe-world-template", "--input", request, "-o", "yaml").out
    assert YAML(typ="safe").load(shown) == answer


def test_the_request_comes_from_text_file_or_standard_input(robomaker, template: str, tmp_path, monkeypatch) -> None:
    path = tmp_path / "request.yaml"
    path.write_text(f"template: {template}\n")
    monkeypatch.setattr("sys.stdin", io.StringIO(path.read_text()))
    outs = [
        robomaker("call", "DescribeWorldTemplate", "--input", given).out
        for given in (f"{{template: '{template}'}}", path, f"file://{path}", "-")
    ]
    assert len(set(outs)) == 1
    assert json.loads(outs[0])["arn"] == template


def test_without_input_the_request_is_empty(robomaker) -> None:
    assert json.loads(robomaker("call", "ListWorlds").out) == {"worldSummaries": []}


def test_built_in_applications_are_listed_by_an_option_of_lists_of_applications(robomaker) -> None:
    assert json.loads(robomaker("call", "ListRobotApplications").out) == {"robotApplicationSummaries": []}
    listed = json.loads(robomaker("call", "list-robot-applications", "--built-in").out)["robotApplicationSummaries"]
    assert {each["name"] for each in listed} == {"scout", "walker"}
    refused = robomaker("call", "ListWorlds", "--built-in")
    assert (refused.code, refused.err) == (
        2,
        "robomaker: --built-in is for lists of applications, and ListWorlds is none\n",
    )


def test_refusals_name_the_error_or_the_place(robomaker) -> None:
    missing = robomaker("call", "DescribeWorld", "--input", '{"world": "arn:aws:robomaker:x:y:world/z"}')
    assert missing.code == 2
    assert missing.err.startswith("robomaker: ResourceNotFoundException: ")
    wrong = robomaker("call", "DescribeWorld", "--input", '{"wold": "arn:x"}')
    assert wrong.code == 2
    assert "--input:1:2: wold: is not known; did you mean 'world'?" in wrong.err
    assert wrong.err.endswith("; nothing was run; docs/operations.md has each operation with an example\n")
    unknown = robomaker("call", "DescribeWolrd")
    assert unknown.code == 2
    assert "did you mean 'DescribeWorld'?" in unknown.err


def test_help_lists_every_operation_with_others_of_its_resource(robomaker) -> None:
    shown = robomaker("call", "--help").out
    for name, shape in OPERATIONS.items():
        assert re.search(rf"^    {name} +{re.escape(shape.description)}$", shown, re.MULTILINE)
    lines = [line.split()[0] for line in shown.partition("\noperations:\n")[2].splitlines()]
    assert lines[lines.index("Tags") :] == ["Tags", "ListTagsForResource", "TagResource", "UntagResource"]


def test_a_job_is_only_stored_and_that_is_said(robomaker, template: str) -> None:
    request = {"template": template, "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1}}
    ended = robomaker("call", "CreateWorldGenerationJob", "--input", json.dumps(request))
    assert ended.code == 0
    assert json.loads(ended.out)["status"] == "Pending"
    assert f"robomaker perform {json.loads(ended.out)['arn']}" in ended.err


def test_what_a_job_waits_for_on_this_machine_is_said_beside_its_description(robomaker, home) -> None:
    request = {"maxJobDurationInSeconds": 60, "iamRole": "arn:aws:iam::000000000000:role/test"}
    world = {"world": "arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1"}
    launch = [{"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [world]}]
    order = json.dumps({"createSimulationJobRequests": [{**request, "simulationApplications": launch}]})
    arn = json.loads(robomaker("call", "StartSimulationJobBatch", "--input", order).out)["arn"]
    record = WaiterRecord(pid=1, name="request 0 of it", batch=arn, since_s=time.time() - 65.0, why="no memory is left")
    WaiterFiles(home / "slots" / "waiting").write("1-other", record, time.time())

    described = robomaker("call", "DescribeSimulationJobBatch", "--input", json.dumps({"batch": arn}))

    assert json.loads(described.out)["status"] == "Pending"
    assert described.err == "request 0 of it has waited 1 min 05 s on this machine: no memory is left\n"


def test_a_job_can_be_carried_to_its_end(robomaker_at_server) -> None:
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "robotApplications": [{"application": "scout", "launchConfig": {}}],
    }
    impossible = robomaker_at_server("call", "CreateSimulationJob", "--input", json.dumps(request))
    assert (impossible.code, "scout plans on the map of a world and the job names none" in impossible.err) == (2, True)

    request["robotApplications"] = [{"application": "scout", "launchConfig": {"command": ["./nothing"]}}]
    stored = json.loads(robomaker_at_server("call", "CreateSimulationJob", "--input", json.dumps(request)).out)
    assert stored["status"] == "Pending"
    ended = robomaker_at_server("perform", stored["arn"])
    answer = json.loads(ended.out)
    # There is no such command: the job fails, not the call.
    assert answer["status"] == "Failed"
    assert ended.code == 3
    refused = robomaker_at_server("perform", "arn:aws:robomaker:us-east-1:000000000000:world/x")
    assert refused.code == 2
    assert "names a world; jobs and batches can be performed" in refused.err


def test_who_left_a_job_and_what_goes_on_with_it_is_told(robomaker_at_server, service: Service) -> None:
    nice = replace(service, settings=service.settings.model_copy(update={"nice": 7}))
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "robotApplications": [{"application": "scout", "launchConfig": {}}],
    }
    with OwnOrder(nice, HeldLeases()) as own:
        arn = registry()["CreateSimulationJob"].ordered(request, own.through, nice)["arn"]
        own.keep(arn)
    name, differences = arn.rpartition("/")[2], "ROBOMAKER_NICE is 0, not 7"
    command = f"ROBOMAKER_NICE=7 robomaker perform {arn}"

    described = robomaker_at_server("call", "DescribeSimulationJob", "--input", json.dumps({"job": arn}))
    assert "carriedOutBy" not in described.out, "the wire stays as it is"
    first, second = described.err.splitlines()
    assert first.startswith(f"{name}: carried out by a Python program (process {os.getpid()} on ")
    assert first.endswith(f", which has left it; job workers with another environment leave it: {differences}")
    assert second == f"Go on with it on {socket.gethostname()}: {command}"

    done = robomaker_at_server("perform", arn)
    assert json.loads(done.out)["status"] == "Failed", "it names no world"
    assert f"{name} was ordered in another environment, and goes on in this one: {differences}" in done.err
    described = robomaker_at_server("call", "DescribeSimulationJob", "--input", json.dumps({"job": arn}))
    assert "leave it" not in described.err


def test_a_verdict_of_fail_ends_a_waited_call_with_1(robomaker_at_server, swing, service: Service) -> None:
    stored = swing(perform=False, LIMIT="0.5")
    request = service.catalog.get(stored["arn"]).document["request"]

    ended = robomaker_at_server("call", "CreateSimulationJob", "--input", json.dumps(request), "--wait")

    answer = json.loads(ended.out)
    assert answer["arn"] != stored["arn"]
    assert (answer["status"], ended.code) == ("Completed", 1)
