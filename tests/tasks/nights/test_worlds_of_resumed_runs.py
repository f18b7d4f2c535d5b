"""Worlds of a run that another process resumes: those that its names meant when it began."""

from collections.abc import Callable
from pathlib import Path

import pytest

from prefect_robomaker.flows.pipelines import PipelineRun
from prefect_robomaker.schemas.reports.names import name_label
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import SpecError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.nights.ending import RunFacts
from prefect_robomaker.tasks.nights.open_runs import OpenRun
from prefect_robomaker.tasks.nights.run_orders import keep_order, ordered_run
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.service.world_names import with_worlds_found

SPEC = """\
version: 1
name: night
steps:
  look: {operation: DescribeWorld, input: {world: kitchen}}
"""


@pytest.fixture
def keep(service: Service) -> Callable[[str], Resource]:
    """Stores a world without files that is called kitchen."""

    def stored(world_id: str) -> Resource:
        world = Resource.new(
            arn=service.arn("world", world_id),
            kind="world",
            id=world_id,
            status="Active",
            labels=name_label("kitchen"),
            document={"name": "kitchen", "bundle": {"bucket": "b", "prefix": f"worlds/{world_id}"}},
        )
        return service.catalog.create(world, token=None)

    return stored


def died(service: Service) -> Path:
    """Begins a run whose process dies before its first step; returns the run's folder."""
    wanted = WantedRun(with_worlds_found(load_spec(SPEC, "night.yaml"), service), "night.yaml")
    folder = service.folder("runs", "night-20260301T020000000")
    facts = RunFacts(wanted=wanted, run_id=folder.name, started_at=service.clock(), source=None, folder=folder)
    begun = keep_order(
        facts,
        service,
        None,
        flow_run=None,
        deployment=None,
        outlasting=lambda call: call(),
        listener=lambda _event: None,
    )
    assert begun is not None
    begun.pass_on()
    return folder


def resumed(folder: Path, service: Service) -> RunRecord:
    claimed = OpenRun.claim(folder)
    assert claimed is not None
    return PipelineRun(ordered_run(claimed), service, lambda _event: None).run()


def test_a_name_that_means_two_worlds_since_does_not_end_a_resumed_run(
    service: Service, keep: Callable[[str], Resource]
) -> None:
    first = keep("import-aaaaaaaaaaaa")
    folder = died(service)
    keep("import-bbbbbbbbbbbb")

    record = resumed(folder, service)

    assert (record.state, [step.output["arn"] for step in record.steps]) == ("succeeded", [first.arn])
    assert record.worlds == {"kitchen": first.arn}
    with pytest.raises(SpecError, match="may be any of 2 worlds"):
        died(service)


def test_a_name_that_means_another_world_since_does_not_change_a_resumed_run(
    service: Service, keep: Callable[[str], Resource]
) -> None:
    """The first world was deleted, so that the step says so; it does not take the other world in silence."""
    first = keep("import-aaaaaaaaaaaa")
    folder = died(service)
    service.catalog.delete(first.arn)
    keep("import-bbbbbbbbbbbb")

    record = resumed(folder, service)

    assert record.state == "broken"
    assert first.arn in (record.steps[0].error or "")
