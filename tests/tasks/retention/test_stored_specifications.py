"""Resources that deployments and runs that broke off name stay."""

import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from prefect_robomaker.deployments.cli.output.retention import report_lines
from prefect_robomaker.schemas.reports.names import name_label
from prefect_robomaker.schemas.reports.retention import RetentionPolicy
from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.retention.collection import collect
from prefect_robomaker.tasks.retention.stored_specifications import StoredSpecification
from prefect_robomaker.tasks.service.service import Service

BUCKET = "their-own-bucket"
MONTH = RetentionPolicy(older_than=timedelta(days=30))
SPEC = """\
version: 1
name: night
parameters:
  house: {default: Bath, enum: [Bath, Attic]}
steps:
  look: {operation: DescribeWorld, input: {world: "${{ parameters.house }}"}}
  vary: {operation: VaryWorlds, input: {worlds: [variation-idid56b0yq33, ARN], variations: [{light: night}]}}
"""


@pytest.fixture
def rooms(service: Service) -> dict[str, str]:
    """ARNs of worlds that no run and no job names, by their names."""
    ids = {"Bath": "variation-bath56b0yq33", "Attic": "import-attic6b0yq33", "by id": "variation-idid56b0yq33"}
    ids |= {"by ARN": "variation-arn056b0yq33", "Cellar": "variation-cell56b0yq33"}
    found: dict[str, str] = {}
    for name, world_id in ids.items():
        arn = found[name] = service.arn("world", world_id)
        document = {"name": name, "bundle": {"bucket": BUCKET, "prefix": f"worlds/{world_id}"}}
        world = Resource.new(
            arn=arn, kind="world", id=world_id, status="Active", labels=name_label(name), document=document
        )
        service.catalog.create(world, token=None)
    return found


ALL_WORLDS = MONTH.model_copy(update={"orphaned_worlds": True, "imported_worlds": True})


def test_worlds_that_a_deployed_specification_names_stay_and_are_told(service: Service, rooms: dict[str, str]) -> None:
    """They are named by id, ARN, name, and by a choice that a run may be given; the next night would have failed."""
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))
    text = SPEC.replace("ARN", rooms["by ARN"])
    deployed = [StoredSpecification("the deployment RunPipeline/night", {"text": text, "origin": "night.yaml"})]

    report = collect(ALL_WORLDS, later, deployed)

    assert [item.id for item in report.removed] == [rooms.pop("Cellar")]
    kept = {item.id: item.reason for item in report.items if item.action == "keep"}
    assert kept == dict.fromkeys(rooms.values(), "the deployment RunPipeline/night names it")
    assert "kept 4: the deployment RunPipeline/night names it" in report_lines(report)


def test_worlds_of_a_run_that_broke_off_stay(service: Service, rooms: dict[str, str]) -> None:
    """Also by the ARN that a name meant when the run began."""
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))
    folder = service.folder("runs", f"night-{later.clock():%Y%m%dT%H%M%S}000")
    worlds = {"Bath": rooms["Cellar"], "Attic": rooms["Attic"]}
    text = SPEC.replace("ARN", rooms["by ARN"])
    order = Order(run_id=folder.name, text=text, filename="n.yaml", spec_path="", command=[], worlds=worlds)
    (folder / "order.json").write_text(order.model_dump_json())
    begun_s = later.clock().timestamp()
    os.utime(folder, (begun_s, begun_s))

    report = collect(ALL_WORLDS, later)

    assert [item.id for item in report.removed] == [rooms["Bath"]]


def test_an_operation_that_is_deployed_keeps_the_jobs_and_worlds_of_its_request(
    service: Service, job: Any, rooms: dict[str, str]
) -> None:
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))
    kept, other = job("sim-1").arn, job("sim-2").arn
    request = {"job": kept, "worlds": [rooms["by ARN"]]}
    deployed = [StoredSpecification("the deployment RestartSimulationJob/x", request, is_pipeline=False)]

    report = collect(ALL_WORLDS.model_copy(update={"sdk_jobs": True}), later, deployed)

    gone = {item.id for item in report.removed}
    assert other in gone
    assert gone.isdisjoint({kept, rooms["by ARN"]})


@pytest.mark.parametrize(
    "unknown",
    ["the Prefect server does not answer", StoredSpecification("the deployment RunPipeline/old", {"text": "a: 1"})],
    ids=["no answer", "no specification"],
)
def test_deployments_that_are_not_known_keep_all_that_they_may_name(
    service: Service, job: Any, rooms: dict[str, str], unknown: StoredSpecification | str
) -> None:
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))
    job("sim-1")

    report = collect(ALL_WORLDS.model_copy(update={"sdk_jobs": True}), later, [unknown])

    assert report.removed == []
    assert any("so jobs of SDKs, worlds and recordings are left: it may name them" in note for note in report.notes)
    assert collect(MONTH, later, [unknown]).notes == []
