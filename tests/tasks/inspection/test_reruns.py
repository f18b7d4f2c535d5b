"""Reruns: which jobs of a run are chosen, and that they are ordered as they were."""

import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.known_failures import KnownFailure, KnownMatch
from prefect_robomaker.schemas.operations.simulation_jobs import SimulationJobRequest
from prefect_robomaker.schemas.reports.run_record import RunRecord, StepRecord
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.resolving import resolve_input
from prefect_robomaker.schemas.wire.errors import ConfigurationError, ResourceNotFoundException
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.inspection.reports import job_records, jobs_of, records_of_ended
from prefect_robomaker.tasks.inspection.reruns import Selection, plan_rerun
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.results.table import ResultTable
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.stored_jobs import store_job

MOMENT = datetime(2026, 3, 2, tzinfo=UTC)
ODD = {"ROOM": "${{ kitchen }}"}


def record_of(**steps: tuple[str, str]) -> RunRecord:
    """The record of a run whose steps made something of an operation."""
    made = [
        StepRecord(name=name, operation=operation, status="Completed", started_at=MOMENT, ended_at=MOMENT, arn=arn)
        for name, (operation, arn) in steps.items()
    ]
    return RunRecord(
        run_id="night-1", name="night", spec_path="night.yaml", state="canceled", exit_code=4, started_at=MOMENT,
        ended_at=MOMENT, steps=made, run_dir=Path("/runs/night-1"),
    )  # fmt: skip


@pytest.fixture
def worlds(service: Service) -> list[str]:
    """Two worlds without a bundle."""
    arns = [service.arn("world", f"generation-a/world-{number}") for number in (1, 2)]
    for arn in arns:
        world = Resource.new(arn=arn, kind="world", id=arn.split(":world/")[1], status="Active", document={})
        service.catalog.create(world, token=None)
    return arns


@pytest.fixture
def batch(service: Service, order: Callable[..., dict[str, Any]], worlds: list[str]) -> tuple[RunRecord, list[str]]:
    """A run with a batch of three requests: the first has passed, the second was cancelled, the third never begun."""
    orders = [order(ODD), order(), order(seed=7)]
    for each, world in zip(orders, [*worlds, worlds[0]], strict=True):
        each.pop("iamRole")
        each["simulationApplications"][0]["worldConfigs"] = [{"world": world}]
    request = {
        "createSimulationJobRequests": orders,
        "batchPolicy": {"maxConcurrency": 2},
        "clientRequestToken": "tonight",
        "tags": {"night": "1"},
    }
    arn = call("StartSimulationJobBatch", request, service)["arn"]
    jobs = [
        store_job(SimulationJobRequest.model_validate(each), service, token=None, batch=(arn, index))
        for index, each in enumerate(orders[:2])
    ]
    for event in ("terminate", "complete"):
        service.catalog.transition(jobs[0].arn, event)
    call("CancelSimulationJob", {"job": jobs[1].arn}, service)
    return record_of(drive=("StartSimulationJobBatch", arn)), [job.id for job in jobs]


def requests_of(text: str, step: str = "drive") -> list[dict[str, Any]]:
    """The requests that the specification of a rerun orders."""
    checked = load_spec(text, "rerun")
    return resolve_input(checked.steps[step], {})["createSimulationJobRequests"]


def test_everything_is_ordered_as_it_was(service: Service, batch: tuple[RunRecord, list[str]]) -> None:
    record, ids = batch
    rerun = plan_rerun(record, Selection(), service)

    assert rerun is not None
    first, second, third = requests_of(rerun.spec_text)
    seeds = [SimulationJobDocument.of(service.catalog.get(service.arn("simulation-job", each))).seed for each in ids]
    assert [each["seed"] for each in (first, second, third)] == [*seeds, 7]
    assert first["simulationApplications"][0]["launchConfig"]["environmentVariables"] == ODD, "no reference to a step"
    request = json.loads(rerun.spec_text)["steps"]["drive"]["input"]
    assert (request["batchPolicy"], request["tags"]) == ({"maxConcurrency": 2}, {"night": "1"})
    assert "clientRequestToken" not in request, "which would give the batch that is there"
    longer = plan_rerun(record, Selection(), service, timeout_s=900)
    assert longer is not None
    policy = json.loads(longer.spec_text)["steps"]["drive"]["input"]["batchPolicy"]
    assert policy == {"maxConcurrency": 2, "timeoutInSeconds": 900}
    assert rerun.rerun_of.earlier == {"drive": [f"{ids[0]}: Completed", f"{ids[1]}: Canceled", "request 3: NotCreated"]}
    assert (rerun.rerun_of.run_id, rerun.rerun_of.selection, rerun.rerun_of.jobs_total) == ("night-1", "all", 3)


@pytest.mark.parametrize(
    ("selection", "places"),
    [
        (Selection(failed=True), [1, 2]),
        (Selection(worlds=("world-1",)), [0, 2]),
        (Selection(worlds=("generation-a/world-1", "world-2")), [0, 1, 2]),
        (Selection(failed=True, worlds=("world-1",)), [2]),
        (Selection(jobs=("request 3",)), [2]),
        (Selection(failed=True, jobs=("request 3",), worlds=("world-1",)), [2]),
    ],
    ids=lambda value: value.words if isinstance(value, Selection) else "",
)
def test_options_combine(
    service: Service, batch: tuple[RunRecord, list[str]], selection: Selection, places: list[int]
) -> None:
    record, _ = batch
    everything = plan_rerun(record, Selection(), service)
    chosen = plan_rerun(record, selection, service)

    assert everything is not None
    assert chosen is not None
    assert requests_of(chosen.spec_text) == [requests_of(everything.spec_text)[place] for place in places]


def test_jobs_are_named_by_id_or_arn(service: Service, batch: tuple[RunRecord, list[str]]) -> None:
    record, ids = batch
    for name in (ids[1], service.arn("simulation-job", ids[1])):
        rerun = plan_rerun(record, Selection(jobs=(name,)), service)
        assert rerun is not None
        assert rerun.rerun_of.earlier == {"drive": [f"{ids[1]}: Canceled"]}


@pytest.fixture
def flats(service: Service) -> list[str]:
    """The first worlds of two generation jobs of templates that are both called flat."""
    document = {"templateName": "flat"}
    arns = [service.arn("world", f"generation-{maker}/world-1") for maker in ("aaaaaa", "bbbbbb")]
    for arn in arns:
        world = Resource.new(arn=arn, kind="world", id=arn.split(":world/")[1], status="Active", document=document)
        service.catalog.create(world, token=None)
    return arns


@pytest.fixture
def night(service: Service, order: Callable[..., dict[str, Any]], flats: list[str]) -> tuple[RunRecord, list[str]]:
    """A run of three jobs: two that differ in a variable, in one flat, and one in the other flat of that name."""
    orders = [order({"SPEED": "1"}, seed=1), order({"SPEED": "2"}, seed=1), order({"SPEED": "1"}, seed=1)]
    for each, world in zip(orders, [flats[0], flats[0], flats[1]], strict=True):
        each["simulationApplications"][0]["worldConfigs"] = [{"world": world}]
    arn = call("StartSimulationJobBatch", {"createSimulationJobRequests": orders}, service)["arn"]
    jobs = [
        store_job(SimulationJobRequest.model_validate(each), service, token=None, batch=(arn, index))
        for index, each in enumerate(orders)
    ]
    return record_of(drive=("StartSimulationJobBatch", arn)), [job.id for job in jobs]


def test_worlds_of_one_name_are_not_taken_for_each_other(service: Service, night: tuple[RunRecord, list[str]]) -> None:
    record, ids = night
    jobs = jobs_of(record.steps, service)
    assert [job.world_name for job in jobs] == [
        "flat 1 (generation-aaaa)",
        "flat 1 (generation-aaaa)",
        "flat 1 (generation-bbbb)",
    ]
    assert [job.name.partition(" in ")[2] for job in jobs] == [
        "flat 1 (generation-aaaa), SPEED=1", "flat 1 (generation-aaaa), SPEED=2", "flat 1 (generation-bbbb)"
    ]  # fmt: skip
    records = job_records(jobs, {}, service)
    assert [each.case_name.partition(" in ")[2] for each in records] == [
        "flat 1, SPEED=1", "flat 1, SPEED=2", "flat 1"
    ], "as in JUnit, also in another run"  # fmt: skip
    table = ResultTable.of(records)
    assert table.texts("world_name") == [job.world_name for job in jobs]
    assert table.texts("job_name") == [job.name for job in jobs]
    assert table.texts("job") == ids


def test_records_of_single_jobs_have_no_names_of_test_cases(
    service: Service, night: tuple[RunRecord, list[str]]
) -> None:
    """Others of their step, which may have the same name, are not known yet."""
    jobs = service.catalog.children(night[0].steps[0].arn or "", kind="simulation-job")
    records, _ = records_of_ended("drive", jobs, service)
    assert {(each.test == each.label, each.case_name) for each in records} == {(True, "")}


def test_jobs_and_worlds_are_named_as_they_are_shown(service: Service, night: tuple[RunRecord, list[str]]) -> None:
    record, ids = night
    names = [job.name for job in jobs_of(record.steps, service)]

    def chosen(**parts: Any) -> list[str]:
        rerun = plan_rerun(record, Selection(**parts), service)
        assert rerun is not None
        return [each.partition(":")[0] for each in rerun.rerun_of.earlier["drive"]]

    assert chosen(jobs=(names[1],)) == [ids[1]]
    assert chosen(jobs=(ids[1][:-1],)) == [ids[1]]
    assert chosen(worlds=("flat 1 (generation-bbbb)",)) == [ids[2]]
    assert chosen(worlds=("generation-bbbb",)) == [ids[2]]
    assert chosen(worlds=("world-1",)) == ids, "of all of these"
    with pytest.raises(ConfigurationError, match=r"no job in the world 'flat 1'; did you mean 'flat 1 \(generation-"):
        chosen(worlds=("flat 1",))
    with pytest.raises(ConfigurationError, match=r"has no job '.* in flat 1, SPEED=2'; did you mean"):
        chosen(jobs=(names[1].replace(" (generation-aaaa)", ""),))


def test_what_is_not_in_the_run_is_told(service: Service, batch: tuple[RunRecord, list[str]]) -> None:
    record, ids = batch
    with pytest.raises(
        ConfigurationError, match=rf"the run night-1 has no job 'none'; it has .*\({ids[0]}\), .*\({ids[1]}\)"
    ):
        plan_rerun(record, Selection(jobs=("none",)), service)
    with pytest.raises(ConfigurationError, match="no job in the world 'world-3'; it has jobs in generation-a/world-1"):
        plan_rerun(record, Selection(worlds=("world-3",)), service)
    with pytest.raises(ConfigurationError, match="no job of the run night-1 is request 3, in world-2"):
        plan_rerun(record, Selection(jobs=("request 3",), worlds=("world-2",)), service)
    with pytest.raises(ConfigurationError, match=r"made no simulation jobs; `robomaker run night.yaml` runs all of it"):
        plan_rerun(record_of(list=("ListWorlds", "")), Selection(failed=True), service)


def test_nothing_that_failed_is_nothing_to_run(service: Service, batch: tuple[RunRecord, list[str]]) -> None:
    record, ids = batch
    assert plan_rerun(record, Selection(failed=True, jobs=(ids[1],)), service) is not None
    assert plan_rerun(record, Selection(failed=True, jobs=(ids[0],)), service) is None


def test_a_job_that_was_deleted_cannot_be_run_again(service: Service) -> None:
    gone = service.arn("simulation-job", "sim-gone")
    with pytest.raises(ResourceNotFoundException, match="there is no resource"):
        plan_rerun(record_of(drive=("CreateSimulationJob", gone)), Selection(), service)


def test_a_rerun_keeps_the_values_that_the_run_had(service: Service, batch: tuple[RunRecord, list[str]]) -> None:
    """Its requests have them already; so its record shows the same ones, and no comparison calls them changed."""
    values = {"worlds": 20, "arm": "b", "share": 0.5, "fast": False, "label": ""}
    rerun = plan_rerun(batch[0].model_copy(update={"parameters": values}), Selection(), service)
    assert rerun is not None
    assert load_spec(rerun.spec_text, "rerun").parameters == values


def test_a_rerun_knows_the_failures_that_the_run_knew(service: Service, batch: tuple[RunRecord, list[str]]) -> None:
    known = KnownFailure(match=KnownMatch(job="flat *", requirement="gentle"), owner="anna", until=MOMENT.date())
    planned = plan_rerun(batch[0].model_copy(update={"known": [known]}), Selection(), service)
    assert planned is not None
    assert load_spec(planned.spec_text, "rerun.json").known == (known,)
