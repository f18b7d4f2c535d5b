"""Runs as they stand: none that failed, lost jobs, goes on or broke off looks as if it had passed."""

import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_night, store_night

from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.nights.kept_answers import KeptAnswers
from prefect_robomaker.tasks.nights.open_runs import OpenRun
from prefect_robomaker.tasks.nights.run_standings import stand_of, table_of
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.results.table import RESULTS_FILE, ResultTable
from prefect_robomaker.tasks.service.service import Service

SPEC = """\
version: 1
name: sleepy
steps:
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        - maxJobDurationInSeconds: 60
          simulationApplications:
            - application: indoor-navigation
              launchConfig: {}
              worldConfigs: [{world: "arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1"}]
"""


def begun(service: Service) -> OpenRun:
    """A run of one batch that goes on in this process."""
    run_id = "sleepy-20260301T020000000"
    folder = service.folder("runs", run_id)
    order = Order(
        run_id=run_id, text=SPEC, filename="spec.yaml", spec_path="spec.yaml", command=[], name="sleepy",
        started_at=datetime(2026, 3, 1, 2, tzinfo=UTC),
    )  # fmt: skip
    return OpenRun.begin(folder, order)


@pytest.mark.parametrize(
    ("letters", "outcome", "passed"),
    [("PP", "succeeded", True), ("PF", "failed", False), ("PE", "broken", False), ("PN", "succeeded", False),
     ("PC", "succeeded", False), ("", "succeeded", False)],
)  # fmt: skip
def test_only_a_run_whose_jobs_were_all_judged_and_passed_has_passed(
    letters: str, outcome: str, passed: bool, service: Service
) -> None:
    folder = store_night(make_night(letters, runs=service.settings.home / "runs"))
    run = stand_of(folder, service)

    assert (run.outcome, run.passed, run.has_ended) == (outcome, passed, True)
    assert table_of(run, service).to_arrow().num_rows == len(letters), "lost jobs have rows, too"


def test_the_table_of_the_folder_is_read_and_a_damaged_one_is_made_again(service: Service) -> None:
    record = make_night("PF", runs=service.settings.home / "runs")
    folder = store_night(record)
    kept = ResultTable.of(record.jobs[:1])
    kept.write(folder / RESULTS_FILE)
    assert len(table_of(stand_of(folder, service), service)) == 1

    (folder / RESULTS_FILE).write_bytes(b"PAR1")
    assert table_of(stand_of(folder, service), service).texts("outcome") == ["passed", "failed"]


def test_a_run_that_goes_on_says_so_and_has_the_jobs_so_far(
    service: Service, order: Callable[..., dict[str, Any]]
) -> None:
    run = begun(service)
    assert (stand_of(run.folder, service).outcome, stand_of(run.folder, service).jobs) == ("running", [])
    answers = KeptAnswers(run.folder, lambda step, request, carry_out: carry_out())
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [_request(order)]}, service)
    answers(load_spec(SPEC, "spec.yaml").steps["drive"], {}, lambda: batch)

    found = stand_of(run.folder, service)
    assert (found.outcome, found.passed, found.has_ended) == ("running", False, False)
    assert [step.arn for step in found.steps] == [batch["arn"]]
    assert set(table_of(found, service).texts("outcome")) <= {"unfinished"}
    run.end()


def _request(order: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    request = order()
    del request["iamRole"]
    return request


def test_a_run_whose_process_died_has_broken_off(service: Service) -> None:
    run = begun(service)
    os.close(run.lock)  # as when the process dies

    assert (stand_of(run.folder, service).outcome, stand_of(run.folder, service).passed) == ("broken off", False)


def test_a_folder_of_no_run_is_refused(service: Service, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="is no run's folder"):
        stand_of(tmp_path, service)


@pytest.mark.parametrize("outcome", ["running", "broken off"])
def test_requests_that_have_not_become_jobs_yet_have_rows(
    outcome: str, service: Service, order: Callable[..., dict[str, Any]]
) -> None:
    run = begun(service)
    answers = KeptAnswers(run.folder, lambda step, request, carry_out: carry_out())
    asked = {"createSimulationJobRequests": [_request(order)] * 5, "batchPolicy": {"maxConcurrency": 1}}
    batch = call("StartSimulationJobBatch", asked, service)
    answers(load_spec(SPEC, "spec.yaml").steps["drive"], {}, lambda: batch)
    if outcome == "broken off":
        os.close(run.lock)

    found = stand_of(run.folder, service)
    assert found.in_words() == f"{outcome}: 0 of 5 jobs passed, 5 unfinished"
    assert table_of(found, service).texts("outcome") == ["unfinished"] * 5
    assert {job.label for job in found.jobs if job.arn is None} <= {f"request {index}" for index in range(1, 6)}
    assert [job.failure_reason for job in found.jobs] == ["the request has not become a job yet"] * 5
