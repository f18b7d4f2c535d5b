"""Results that jobs take over: of jobs with the same inputs that ended by themselves, and of no others."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.roles import roles_file
from helpers.swing_fixtures import ROLE, upload_swinger

from prefect_robomaker.schemas.documents.simulation_jobs import (
    MadeOf,
    SimulationJobBatchDocument,
    SimulationJobDocument,
)
from prefect_robomaker.schemas.operations.registry import parse_request
from prefect_robomaker.schemas.operations.simulation_jobs import CreateSimulationJobRequest
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.jobs.batch_runs import BatchRun
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.operations.simulation_job_batches import perform_simulation_job_batch
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning.job_contents import CurrentApplications, contents_of_request
from prefect_robomaker.tasks.simulations.stored_jobs import find_results, job_document
from prefect_robomaker.tasks.storage import thin, unpublish
from prefect_robomaker.tasks.storage.roles import open_roles

Simulate = Callable[..., dict[str, Any]]


@pytest.fixture
def reusing(service: Service) -> Service:
    """The service in a run that may take over results."""
    return service.ordered_by("night-2", reuse=True)


def stored(service: Service, job: dict[str, Any]) -> Resource:
    return service.catalog.get(job["arn"])


def document(service: Service, job: dict[str, Any]) -> SimulationJobDocument:
    return SimulationJobDocument.of(stored(service, job))


def order_again(reusing: Service, job: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Orders what an earlier job was ordered with."""
    return call("CreateSimulationJob", {**document(reusing, job).request, **changes}, reusing)


def made_of_now(reusing: Service, job: dict[str, Any]) -> MadeOf:
    """Contents of an earlier job's applications as they are now."""
    return contents_of_request(document(reusing, job).request, reusing, CurrentApplications(reusing))


def test_a_job_of_the_same_inputs_has_the_same_results_without_running(
    swing: Simulate, service: Service, reusing: Service
) -> None:
    first = swing(TIME_LIMIT_S="1", LIMIT="-9")

    second = order_again(reusing, first, tags={"night": "2"})
    assert second["status"] == "Completed", "it has ended as soon as it is there"
    assert second["arn"] != first["arn"]
    perform_job(second["arn"], service)
    told = call("DescribeSimulationJob", {"job": second["arn"]}, service)
    assert (told["status"], told["tags"]) == ("Completed", {"night": "2"})
    assert told["simulationTimeMillis"] == first["simulationTimeMillis"]
    earlier, later = document(service, first), document(service, second)
    assert later.outputs == earlier.outputs
    assert later.verdict == earlier.verdict == "FAIL"
    assert later.verdict_reason == earlier.verdict_reason is not None
    assert later.run_id is None
    assert later.reused_from is not None
    assert (later.reused_from.job, later.reused_from.spec_run, later.spec_run) == (first["arn"], None, "night-2")

    third = order_again(service.ordered_by("night-3", reuse=True), second)
    origin = document(service, third).reused_from
    assert origin is not None
    assert origin.job == first["arn"], "where the results come from, not who had them last"


def test_without_reuse_everything_is_run(swing: Simulate, service: Service) -> None:
    first = swing(TIME_LIMIT_S="1")

    assert order_again(service, first)["status"] == "Pending"
    assert order_again(service.ordered_by("night-2", reuse=False), first)["status"] == "Pending"


def test_other_inputs_are_run(swing: Simulate, reusing: Service, tmp_path: Path) -> None:
    first = swing(TIME_LIMIT_S="1")
    request = document(reusing, first).request
    without_seed = {name: value for name, value in request.items() if name != "seed"}

    assert order_again(reusing, first)["status"] == "Completed"
    for changes in ({"seed": 4}, {"maxJobDurationInSeconds": 61}, {"video": "always"}, {"iamRole": f"{ROLE}-b"}):
        assert order_again(reusing, first, **changes)["status"] == "Pending", changes
    assert call("CreateSimulationJob", without_seed, reusing)["status"] == "Pending"
    upload_swinger(reusing, tmp_path, b"another policy")
    assert order_again(reusing, first)["status"] == "Pending", "the archive is another one"


def test_code_that_judges_is_compared_and_code_that_it_imports(
    swing: Simulate, reusing: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    law, statutes = tmp_path / "lib" / "swing_law.py", tmp_path / "lib" / "swing_statutes.py"
    law.parent.mkdir()
    law.write_text("import swing_statutes\n\n\ndef holds(environment, time_s):\n    return swing_statutes.ANSWER\n")
    statutes.write_text("ANSWER = True\n")
    monkeypatch.syspath_prepend(law.parent)
    asked = [{"kind": "predicate", "name": "law", "attribute": "swing_law.holds"}]
    first = swing(TIME_LIMIT_S="1", job={"requirements": asked})
    assert document(reusing, first).verdict == "PASS"

    assert order_again(reusing, first)["status"] == "Completed"
    statutes.write_text("ANSWER = False\n")
    assert order_again(reusing, first)["status"] == "Pending", "no request names the module, the run imported it"
    statutes.write_text("ANSWER = True\n")
    assert order_again(reusing, first)["status"] == "Completed"
    law.write_text(law.read_text() + "\n# stricter from now on\n")
    assert order_again(reusing, first)["status"] == "Pending"


@pytest.mark.parametrize(
    "variables",
    [
        {"FAIL_AT": "3"},
        pytest.param({"KILL_AT": "3"}, marks=pytest.mark.deep),
        pytest.param({"duration_s": 1, "SLEEP_S": "0.2", "CLOSED": "1"}, marks=pytest.mark.deep),
    ],
    ids=["crash", "kill", "duration limit"],
)
def test_what_did_not_end_by_itself_is_run_again(swing: Simulate, reusing: Service, variables: dict[str, Any]) -> None:
    first = swing(**variables)

    assert order_again(reusing, first)["status"] == "Pending"


def test_canceled_jobs_are_run_again(swing: Simulate, service: Service, reusing: Service) -> None:
    first = swing(perform=False)
    call("CancelSimulationJob", {"job": first["arn"]}, service)

    assert order_again(reusing, first)["status"] == "Pending"


def test_jobs_with_programs_are_run_again(swing: Simulate, reusing: Service) -> None:
    first = swing(TIME_LIMIT_S="1", robot={"tools": [{"name": "watch", "command": "sleep 60"}]})

    assert first["status"] == "Completed"
    made_of = document(reusing, first).made_of
    assert made_of is not None
    assert made_of.once_only == "it runs programs (robot-watch), whose timing no seed repeats"
    assert order_again(reusing, first)["status"] == "Pending"


def test_results_that_are_gone_are_made_again(swing: Simulate, service: Service, reusing: Service) -> None:
    first = swing(TIME_LIMIT_S="1")
    place = document(service, first).outputs
    assert place is not None
    unpublish(service.store, place.bucket, place.prefix)

    assert order_again(reusing, first)["status"] == "Pending"


def test_results_without_their_recordings_are_made_again(swing: Simulate, service: Service, reusing: Service) -> None:
    first = swing(TIME_LIMIT_S="1")
    place = document(service, first).outputs
    assert place is not None
    thin(service.store, place.bucket, place.prefix, lambda name: name == "result.json")

    assert order_again(reusing, first)["status"] == "Pending"


def test_results_of_which_a_file_is_gone_are_made_again(swing: Simulate, service: Service, reusing: Service) -> None:
    first = swing(TIME_LIMIT_S="1")
    place = document(service, first).outputs
    assert place is not None
    service.store.delete(place.bucket, f"{place.prefix}/recording.mcap")

    assert order_again(reusing, first)["status"] == "Pending"
    request = parse_request("CreateSimulationJob", document(reusing, first).request)
    assert isinstance(request, CreateSimulationJobRequest)
    found = find_results(job_document(request, reusing), made_of_now(reusing, first), reusing)
    id_ = stored(service, first).id
    assert found.why_not == f"{id_} has outputs of which recording.mcap is gone from the object store"


@pytest.mark.parametrize(
    ("arn", "place", "status"),
    [(ROLE, "robomaker/*", "Completed"), (ROLE, "other/*", "Pending"), (f"{ROLE}-b", "robomaker/*", "Pending")],
    ids=["may read", "may not read", "is not there"],
)
def test_results_that_the_role_of_a_job_may_not_read_are_not_taken_over(
    swing: Simulate, reusing: Service, tmp_path: Path, arn: str, place: str, status: str
) -> None:
    first = swing(TIME_LIMIT_S="1")
    path = roles_file(tmp_path, f'arn = "{arn}"\nread = ["{place}"]\n')
    settings = reusing.settings.model_copy(update={"roles_file": path})
    confined = replace(reusing, settings=settings, roles=open_roles(settings, reusing.store, {}))

    assert order_again(confined, first)["status"] == status


@pytest.mark.slow
def test_a_batch_runs_only_what_is_not_there(
    swing: Simulate, service: Service, reusing: Service, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = swing(TIME_LIMIT_S="1")
    request = document(service, first).request
    orders = [request, {**request, "seed": 9}, request, {**request, "maxJobDurationInSeconds": 61}]
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": orders}, reusing)
    begun: list[int] = []
    create_job = BatchRun.create_job
    monkeypatch.setattr(BatchRun, "create_job", lambda run, index: begun.append(index) or create_job(run, index))

    perform_simulation_job_batch(batch["arn"], service)

    jobs = service.catalog.children(batch["arn"], kind="simulation-job")
    by_place = {each.request_index: each for each in map(SimulationJobDocument.of, jobs)}
    assert sorted(begun) == [1, 3], "a worker that knows nothing of the run reads it in the batch"
    assert [bool(by_place[place].reused_from) for place in range(4)] == [True, False, True, False]
    assert {job.status for job in jobs} == {"Completed"}
    assert {each.spec_run for each in by_place.values()} == {"night-2"}
    ended = SimulationJobBatchDocument.of(service.catalog.get(batch["arn"]))
    assert ended.verdicts == {"PASS": 4}, "results that are taken over are judged, too"
