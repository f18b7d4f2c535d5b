"""Every example of the page about all operations, made for real, one after the other."""

import json
import re
import shlex
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from helpers.job_worker_process import AwaitStatus, PerformElsewhere
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz
from tools.reference.examples import ARCHIVE, EXAMPLES, MADE_BY
from tools.reference.operations_page import command
from tools.reference.pages import DOCS

BUNDLE = REPOSITORY / "deployments" / "specs" / "examples" / "cartpole_bundle"


class Walk:
    """Makes examples as they are on the page, with the ARNs that earlier answers gave."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self.ids: dict[str, str] = {}
        """The id that stands on the page, and the one there is."""
        text = (DOCS / "operations.md").read_text()
        commands = re.findall(r"^```console\n\$ (robomaker call .*?)^```$", text, re.MULTILINE | re.DOTALL)
        words = [shlex.split(each) for each in commands]
        assert all(each[:2] == ["robomaker", "call"] and each[3] == "--input" and len(each) == 5 for each in words)
        self.requests = {each[2]: each[4] for each in words}

    def make(self, operation: str) -> dict[str, Any]:
        """Makes an operation's example."""
        text = self.requests[operation]
        for shown, made in self.ids.items():
            text = text.replace(shown, made)
        answer = call(operation, json.loads(text), self.service)
        if operation in MADE_BY:
            self.ids[id_of(MADE_BY[operation])] = id_of(answer["arn"])
        return answer


def id_of(arn: str) -> str:
    """What of an ARN tells it from others of its kind."""
    return arn.split(":", 5)[5].split("/", 1)[1]


@pytest.fixture
def walk(service: Service, tmp_path: Path) -> Walk:
    """A service with the archive that the examples use."""
    archive = tmp_path / "cartpole.tar.gz"
    pack_tar_gz(BUNDLE, archive)
    service.store.ensure_bucket(ARCHIVE["s3Bucket"])
    service.store.put_file(ARCHIVE["s3Bucket"], ARCHIVE["s3Key"], archive)
    return Walk(service)


@pytest.mark.deep
@pytest.mark.slow
def test_every_example_works(
    walk: Walk, service: Service, prefect_server: str, perform_elsewhere: PerformElsewhere, await_status: AwaitStatus
) -> None:
    answers: dict[str, dict[str, Any]] = {}
    with ExitStack() as stack:
        for operation in EXAMPLES:
            if operation == "RestartSimulationJob":
                job = answers["CreateSimulationJob"]["arn"]
                stack.enter_context(perform_elsewhere(job))
                await_status(job, "Running")
            answers[operation] = walk.make(operation)
            if operation == "CreateWorldGenerationJob":
                registry()[operation].perform(answers[operation]["arn"], service)
            if operation == "CancelSimulationJob":
                await_status(answers["CreateSimulationJob"]["arn"], "Canceled")

    assert set(answers) == set(OPERATIONS)
    for operation, answer in answers.items():
        member = OPERATIONS[operation].result_key
        assert member is None or operation == "ListSimulationJobBatches" or answer[member], f"{operation} finds nothing"
    assert answers["DescribeWorldGenerationJob"]["finishedWorldsSummary"]["finishedCount"] == 1
    assert answers["DescribeWorld"]["tags"] == {"purpose": "nightly"}
    assert answers["ListTagsForResource"]["tags"] == {"purpose": "nightly", "reviewed": "yes"}
    assert answers["BatchDeleteWorlds"] == {"unprocessedWorlds": []}
    assert [robot["name"] for robot in answers["DescribeFleet"]["robots"]] == ["rover"]


def test_there_is_an_example_of_each_operation_that_a_shell_takes() -> None:
    assert set(EXAMPLES) == set(OPERATIONS)
    for operation, request in EXAMPLES.items():
        words = shlex.split(command(operation))
        assert words[:4] == ["robomaker", "call", operation, "--input"]
        assert json.loads(words[4]) == request
