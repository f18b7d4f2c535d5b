"""A catalog of the release before documents said their version: it opens, reads the same, and its jobs go on.

`data/catalog-1.sql` is the dump of one with every kind of resource in several statuses: each was made by calling the
operations. `data/catalog-1.answers.json` has what that release answered to every description and list of it.
"""

import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

DATA = Path(__file__).parent / "data"
DESCRIBE = {
    "deployment-fleet": ("DescribeFleet", "fleet"),
    "deployment-job": ("DescribeDeploymentJob", "job"),
    "robot": ("DescribeRobot", "robot"),
    "robot-application": ("DescribeRobotApplication", "application"),
    "simulation-application": ("DescribeSimulationApplication", "application"),
    "simulation-job": ("DescribeSimulationJob", "job"),
    "simulation-job-batch": ("DescribeSimulationJobBatch", "batch"),
    "world": ("DescribeWorld", "world"),
    "world-export-job": ("DescribeWorldExportJob", "job"),
    "world-generation-job": ("DescribeWorldGenerationJob", "job"),
    "world-template": ("DescribeWorldTemplate", "template"),
}
LISTS = ("Fleets", "DeploymentJobs", "Robots", "RobotApplications", "SimulationApplications", "SimulationJobs")
LISTS += ("SimulationJobBatches", "Worlds", "WorldExportJobs", "WorldGenerationJobs", "WorldTemplates")
ALL_VERSIONS = {"versionQualifier": "ALL"}
BUILT_IN = {"scout", "walker", "indoor-navigation"}
TOLD_SINCE = {
    "applicationVersion": "$LATEST",
    "uploadConfigurations": [],
    "useDefaultUploadConfigurations": False,
    "useDefaultTools": False,
}
"""What a simulation job says since of each application that did not: the defaults that hold for it."""


def all_of(service: Service) -> list[tuple[str, str]]:
    """Kind and ARN of everything in the catalog."""
    with sqlite3.connect(service.settings.home / "catalog.db") as database:
        return list(database.execute("SELECT kind, arn FROM resources ORDER BY sequence"))


def answers(service: Service) -> dict[str, Any]:
    """What the operations that read answer about everything in the catalog."""
    told: dict[str, Any] = {}
    for kind, arn in all_of(service):
        application, _, version = arn.partition("/version/")
        operation, member = DESCRIBE[kind.removesuffix("-version")]
        chosen = {"applicationVersion": version} if version else {}
        told[f"{operation} {arn}"] = call(operation, {member: application, **chosen}, service)
        told[f"ListTagsForResource {application}"] = call("ListTagsForResource", {"resourceArn": application}, service)
        if kind == "world-template":
            told[f"GetWorldTemplateBody {arn}"] = call("GetWorldTemplateBody", {"template": arn}, service)
    for name in LISTS:
        told[f"List{name}"] = call(f"List{name}", ALL_VERSIONS if "Applications" in name else {}, service)
    return json.loads(json.dumps(told, default=str))


def add_descriptions(service: Service) -> None:
    """Puts something where the catalog says that the worlds' descriptions are."""
    for kind, arn in all_of(service):
        if kind == "world":
            document = service.catalog.get(arn).document
            service.store.ensure_bucket(document["bundle"]["bucket"])
            service.store.put_bytes(document["bundle"]["bucket"], document["descriptionKey"], b"{}")


@pytest.fixture
def old(settings: Settings) -> Iterator[Service]:
    """A service that goes on with the catalog."""
    settings.home.mkdir(parents=True)
    with sqlite3.connect(settings.home / "catalog.db") as database:
        database.executescript((DATA / "catalog-1.sql").read_text(encoding="utf-8"))
    service = Service.open(settings, {})
    add_descriptions(service)
    yield service
    service.catalog.close()


def pending(service: Service, kind: str) -> str:
    [arn] = [arn for each, arn in all_of(service) if each == kind and service.catalog.get(arn).status == "Pending"]
    return arn


def test_everything_is_told_as_that_release_told_it(old: Service) -> None:
    expected = json.loads((DATA / "catalog-1.answers.json").read_text(encoding="utf-8"))
    for description, told in expected.items():
        if description in ("ListRobotApplications", "ListSimulationApplications"):
            # Those that are built in are listed no more.
            [(member, listed)] = told.items()
            told[member] = [each for each in listed if each["name"] not in BUILT_IN]
        if description.startswith("DescribeSimulationJob "):
            told |= {"loggingConfig": {"recordAllRosTopics": False}, "simulationTimeMillis": 0, **told}
        for member in ("simulationApplications", "robotApplications"):
            if isinstance(told.get(member), list):
                told[member] = [{**TOLD_SINCE, **each} for each in told[member]]
    assert answers(old) == expected


def test_no_document_was_rewritten(old: Service) -> None:
    assert all("schema_version" not in old.catalog.get(arn).document for _, arn in all_of(old))


@pytest.mark.parametrize(
    ("operation", "kind"),
    [
        pytest.param("CreateSimulationJob", "simulation-job", marks=pytest.mark.deep),
        ("StartSimulationJobBatch", "simulation-job-batch"),
        pytest.param("CreateWorldGenerationJob", "world-generation-job", marks=pytest.mark.deep),
    ],
)
def test_a_pending_job_is_performed(old: Service, prefect_server: str, operation: str, kind: str) -> None:
    del prefect_server
    done = registry()[operation].perform(pending(old, kind), old)
    assert (done["status"], done.get("failureReason")) == ("Completed", None)


def test_a_repeated_call_finds_what_it_made(old: Service) -> None:
    request = {
        "fleet": next(arn for kind, arn in all_of(old) if kind == "deployment-fleet"),
        "clientRequestToken": "dep-2",
    }
    assert call("SyncDeploymentJob", request, old)["status"] == "Pending"


def test_a_pending_job_is_cancelled(old: Service) -> None:
    for kind, operation in (
        ("simulation-job", "CancelSimulationJob"),
        ("world-export-job", "CancelWorldExportJob"),
        ("deployment-job", "CancelDeploymentJob"),
    ):
        arn = pending(old, kind)
        call(operation, {"job": arn}, old)
        assert old.catalog.get(arn).status == "Canceled"
