"""Results of earlier runs in Python."""

import builtins
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker import Job, Run, results
from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.exit_codes import IN_WORDS
from prefect_robomaker.schemas.reports.challenge import Challenge, ChallengedJob, ControlResult, SabotageResult
from prefect_robomaker.schemas.reports.live_comparison import AgainstAnswer, Answer
from prefect_robomaker.schemas.reports.run_exit_codes import exit_code_of
from prefect_robomaker.schemas.reports.run_record import JobRecord
from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.wire.errors import (
    ConfigurationError,
    ObjectNotFoundError,
    ResourceNotFoundException,
    StorageUnavailableError,
    UnknownNameError,
)
from prefect_robomaker.tasks.nights.run_standings import StandingRun
from prefect_robomaker.tasks.service.service import Service


def stored(service: Service, letters: Any, night: int = 0) -> Run:
    record = make_night(letters, night, runs=service.settings.home / "runs")
    store_night(record)
    with service.activated():
        return results(record.run_id)


def test_a_run_is_named_by_id_folder_or_latest(service: Service) -> None:
    stored(service, "P")
    run = stored(service, "PF", night=1)
    with service.activated():
        same = [results(), results("latest"), results(run.id), results(run.folder), results(str(run.folder))]
        with pytest.raises(ConfigurationError, match="there is no run 'nightly-1'"):
            results("nightly-1")

    assert {each.id for each in same} == {run.id}


def test_a_job_is_printed_in_one_line(service: Service) -> None:
    job = stored(service, "F").jobs[0]
    assert str(job) == repr(job) == f"<Job {job.id}, {job.title}: failed>"


def test_a_run_that_lost_jobs_does_not_look_green(service: Service) -> None:
    lost = JobRecord(label="request 3", status="NotCreated", failure_code="LimitExceeded", failure_reason="too many")
    run = stored(service, [*make_night("PFE").jobs, lost])

    assert (run.outcome, run.passed, len(run.jobs), len(run.rows)) == ("succeeded", False, 4, 4)
    assert [row.outcome for row in run.rows] == ["passed", "failed", "broken", "broken"]
    assert [job.outcome for job in run.jobs] == [row.outcome for row in run.rows]
    assert "2 broke" in repr(run)
    assert run.rows[3].job == "request 3"
    with pytest.raises(TypeError, match=r"neither true nor false; ask whether it \.passed"):
        bool(run)
    with pytest.raises(ResourceNotFoundException, match="request 3 of step None never became a job: too many"):
        run.jobs[3].open("result.json")


def test_known_failures_are_told(service: Service) -> None:
    record = make_night("PF", runs=service.settings.home / "runs")
    jobs = [job.model_copy(update={"known": "anna until 2026-03-01" * (job.verdict == "FAIL")}) for job in record.jobs]
    store_night(record.model_copy(update={"jobs": jobs, "known_notes": ["one did not occur"]}))
    with service.activated():
        run = results(record.run_id)
    assert [job.known for job in run.jobs] == ["", "anna until 2026-03-01"]
    assert run.known_notes == ["one did not occur"]


def test_each_outcome_has_its_exit_code_and_meaning(service: Service) -> None:
    assert (stored(service, "PF").exit_code, stored(service, "PF", 1).meaning) == (1, "a simulation's verdict is fail")
    assert (stored(service, "PE", 2).exit_code, stored(service, "P", 3).exit_code) == (3, 0)


ANSWERS: list[Answer] = ["better", "not worse", "worse", "no difference shown", "not comparable"]


@pytest.mark.parametrize("answer", ANSWERS)
def test_the_meaning_of_a_run_beside_an_earlier_one_is_its_answer(answer: Answer, service: Service) -> None:
    against = AgainstAnswer(run_id="nightly-1", alpha=0.05, answer=answer, why="so it is", pairs=9, planned=9)
    record = make_night("PF", runs=service.settings.home / "runs")
    store_night(record.model_copy(update={"against": against, "exit_code": exit_code_of("failed", against)}))
    with service.activated():
        run = results(record.run_id)

    assert run.meaning.endswith("so it is")
    assert answer.split()[0] in run.meaning
    assert run.meaning in run._repr_html_()
    assert not {"all well", "a simulation's verdict is fail"} & {run.meaning}
    assert IN_WORDS[run.exit_code or 0]


def test_a_run_that_broke_beside_an_earlier_one_is_not_told_by_its_answer(service: Service) -> None:
    against = AgainstAnswer(run_id="nightly-1", alpha=0.05, answer="better", why="so it is", pairs=9, planned=9)
    record = make_night("PE", runs=service.settings.home / "runs")
    store_night(record.model_copy(update={"against": against}))
    with service.activated():
        assert results(record.run_id).meaning == "something broke"


@pytest.mark.parametrize(
    ("letters", "jobs", "meaning"),
    [
        ("PF", ["passes"], "1 of 2 sabotages caught"),
        ("PE", ["passes"], "something broke: 1 of 2 sabotages caught"),
        ("E", [], "something broke"),
    ],
)
def test_the_meaning_of_a_challenge_is_its_headline(
    letters: str, jobs: list[ControlResult], meaning: str, service: Service
) -> None:
    sabotages = [SabotageResult(name="slow", axes={}, caught=1), SabotageResult(name="blind", axes={}, missed=1)]
    challenge = Challenge(sabotages=sabotages, jobs=[ChallengedJob(name="drive", control=each) for each in jobs])
    record = make_night(letters, runs=service.settings.home / "runs")
    store_night(record.model_copy(update={"challenge": challenge}))
    with service.activated():
        assert results(record.run_id).meaning == meaning


def test_rows_are_typed_and_the_same_as_those_of_the_table(service: Service) -> None:
    run = stored(service, [make_job(0, "F", metrics={"distance_m": 3.5, "sim_time_s": 8.0})])
    (row,) = run.rows
    (cells,) = run.to_arrow().to_pylist()

    assert (row.metrics["distance_m"], row.sim_time_s, row.seed, row.trial) == (3.5, 8.0, 7, None)
    assert (row.requirements[0].name, row.requirements[0].margin) == ("gentle", -4.0)
    assert cells["metric.distance_m"] == 3.5
    assert cells["requirement.gentle"] is False


def test_without_pandas_one_is_told_what_to_do(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    load = builtins.__import__

    def without_pandas(name: str, *rest: Any) -> Any:
        if name == "pandas":
            raise ModuleNotFoundError(name, name=name)
        return load(name, *rest)

    run = stored(service, "P")
    monkeypatch.setattr(builtins, "__import__", without_pandas)
    with pytest.raises(
        ImportError,
        match=r"^to_pandas\(\) needs pandas, which is not installed: `cd .* && .tools/bin/uv pip install pandas`",
    ):
        run.to_pandas()


def test_pandas_that_cannot_be_loaded_says_so(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    load = builtins.__import__

    def with_broken_pandas(name: str, *rest: Any) -> Any:
        if name == "pandas":
            raise ImportError("numpy is too old for it")
        return load(name, *rest)

    run = stored(service, "P")
    monkeypatch.setattr(builtins, "__import__", with_broken_pandas)
    with pytest.raises(ImportError, match="cannot be loaded: numpy is too old for it; use") as caught:
        run.to_pandas()
    assert str(caught.value.__cause__) == "numpy is too old for it"


def test_a_name_without_a_value_says_which_names_there_are(service: Service) -> None:
    run = stored(service, [make_job(0, "F", metrics={"distance_m": 3.5})])
    (row,) = run.rows

    with pytest.raises(
        UnknownNameError, match=r"^there is no metric 'distance'; did you mean 'distance_m'\?; there are"
    ):
        row.metrics["distance"]
    with pytest.raises(KeyError, match=r"there is no axis 'mass'; there are none"):
        row.axes["mass"]
    assert row.metrics.get("distance") is None
    assert "distance" not in row.metrics


def test_a_misspelt_specification_is_told(service: Service) -> None:
    run = stored(service, "P")
    with service.activated(), pytest.raises(ConfigurationError, match=rf"did you mean '{run.name}'"):
        results(f"{run.name[:-2]}{run.name[-1]}")


def test_a_request_that_waits_is_unfinished_and_has_no_outputs_yet(service: Service) -> None:
    waits = JobRecord(label="request 3", step="drive", status="Pending", failure_reason="not yet")
    job = Run(StandingRun("r", "r", service.settings.home, "running", steps=[], jobs=[waits]), service).jobs[0]

    assert (job.outcome, job.verdict, job.outputs) == ("unfinished", None, {})
    with pytest.raises(ResourceNotFoundException, match=r"^request 3 of step drive has not become a job yet$"):
        job.open("result.json")


@pytest.fixture
def slept(service: Service, order: Callable[..., dict[str, Any]], simulate: Callable[..., dict[str, Any]]) -> Run:
    """A run of one job that has outputs."""
    job = simulate(order({"SLEEP_S": "0.1"}))
    record = make_job(0, "P").model_copy(update={"arn": job["arn"], "label": job["arn"].rpartition("/")[2]})
    return stored(service, [record])


def test_outputs_of_a_job_are_read_where_they_are(
    slept: Run, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    (job,) = slept.jobs
    with job.open("result.json") as file:
        local = file.read()
    assert {"result.json", "provenance.json"} <= set(job.outputs)
    assert Path(job.outputs["result.json"].removeprefix("file://")).read_bytes() == local
    assert job.result().seed == SimulationJobDocument.of(service.catalog.get(str(job.record.arn))).seed
    # As a store does whose objects are no files here.
    monkeypatch.setattr(type(service.store), "local_path", lambda *_: None)
    with job.open("result.json") as file:
        assert (file.read(), file.seek(0), file.read()) == (local, 0, local)
    assert list(service.folder("scratch").iterdir()) == []


def test_an_unknown_output_says_which_there_are_and_a_silent_store_is_no_lack_of_outputs(
    slept: Run, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    (job,) = slept.jobs
    with pytest.raises(ObjectNotFoundError, match=r"has no output 'resul\.json'; did you mean 'result\.json'\?; there"):
        job.open("resul.json")
    with pytest.raises(
        UnknownNameError, match=r"there is no output 'resul\.json'; did you mean 'result\.json'\?; there"
    ):
        job.outputs["resul.json"]
    with pytest.raises(ObjectNotFoundError, match=r"has no output '\.\./manifest\.json'"):
        job.open("../manifest.json")

    def silent(*_: Any) -> bytes:
        raise StorageUnavailableError("it does not answer")

    monkeypatch.setattr(type(service.store), "get_bytes", silent)
    with service.activated(), pytest.raises(StorageUnavailableError):
        results().jobs[0].open("result.json")


def test_a_job_that_was_cancelled_has_no_verdict_whatever_it_had_stored(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    passed = RunResult(
        verdict="PASS", sim_time_s=1.0, wall_time_s=1.0, real_time_factor=1.0, ended_by="environment", seed=7
    )
    monkeypatch.setattr(Job, "open", lambda *_: BytesIO(passed.model_dump_json().encode()))
    ended = make_job(0, "P")
    for status, verdict in (("Completed", "PASS"), ("Canceled", "NONE")):
        job = ended.model_copy(update={"status": status})
        run = Run(StandingRun("r", "r", service.settings.home, "succeeded", steps=[], jobs=[job]), service)

        assert (run.jobs[0].result().verdict, run.passed) == (verdict, verdict == "PASS")
        assert run.jobs[0].verdict == (verdict if verdict == "PASS" else None)
