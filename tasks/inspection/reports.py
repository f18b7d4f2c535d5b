"""Gathers the stored data of a run for its report and its record."""

import importlib.metadata
import platform
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...schemas.documents.simulation_jobs import ReusedFrom, SimulationJobBatchDocument, SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace
from ...schemas.job_owners import JobOwner
from ...schemas.reports.challenge import Challenge
from ...schemas.reports.live_comparison import in_words
from ...schemas.reports.names import application_name, job_name, short_name, unique_job_names, unique_world_names
from ...schemas.reports.report import (
    AxisResult,
    Report,
    ReportedJob,
    ReportedStep,
    ReportedWorld,
    ReportSummary,
    RunState,
)
from ...schemas.reports.run_exit_codes import exit_code_of
from ...schemas.reports.run_record import JobRecord, RerunOf, RunRecord, StepRecord, interrupted_in_words
from ...schemas.reports.run_states import run_state, state_in_words, with_known
from ...schemas.reports.variants import variants
from ...schemas.runs.trial_rows import fails_besides
from ...schemas.wire.common import passed_of
from ...schemas.wire.errors import ResourceNotFoundException, StorageError
from ..catalog import Resource
from ..causes.effects import axis_effects
from ..causes.explanation import explain
from ..causes.stored import write_why
from ..comparison.compared_runs import NightRun
from ..execution.prefect_events import tell_of_report
from ..execution.task_pool import current_flow_run
from ..reporting import Outcome, case_names, classify, junit_xml, markdown_report, summarize, write_report
from ..reporting.console_pages import ConsolePages, pages_elsewhere
from ..reporting.nights.changes import losses_in_words
from ..results.table import ResultTable
from ..service.references import name_of_job, name_of_world, names_of_worlds
from ..service.service import Service
from ..simulations.inputs.bundles import world_bundle
from ..simulations.planning.run_plans import world_arn
from ..worlds.previews import preview_of
from .challenges import judged_challenge
from .job_outputs import (
    drawn_trial,
    inputs_of_request,
    judged_without_outputs,
    outputs_of,
    places_of,
    results_of,
    told_of_twins,
    with_inputs,
    write_results,
)
from .run_records import is_night, since_last

REPORT_NAME = "report.html"
_STOPPED = (
    "no cause is claimed of a run beside an earlier one, since its trials decide when it ends; a run without --against "
    "would do"
)
_MOST_LOST = 10
"""Maximum number of jobs named in a line about lost jobs."""
_PACKAGES = ("prefect-robomaker", "prefect", "mujoco", "dm-control", "numpy")


def publish_report(record: RunRecord, service: Service, state_of: Callable[[list[JobRecord]], RunState]) -> RunRecord:
    """Writes the report of a run that ends, and shows its main parts in Prefect's UI.

    Args:
        record: Record of the run, without its jobs.
        service: Service that stores the run's resources.
        state_of: Function that decides from the jobs how the run ended.

    Returns:
        The record with the run's jobs, its state, and the report's path.
    """
    report, jobs, results = _gathered(record, service)
    jobs, notes = with_known(record, jobs)
    state = _state_of_challenge(state_of([]), report.challenge) if report.challenge else state_of(jobs)
    code = exit_code_of(state, record.against)
    record = record.model_copy(
        update={
            "jobs": jobs, "state": state, "exit_code": code, "challenge": report.challenge, "known_notes": notes
        }
    )  # fmt: skip
    report = _with_changes(_told_of_known(report, jobs, notes).model_copy(update={"state": state}), record)
    return record.model_copy(
        update={"report_path": _publish(report, jobs, results, record.run_dir, pages_elsewhere(service.settings))}
    )


def rebuild_report(
    record: RunRecord, service: Service, *, junit: Path | None = None, markdown: Path | None = None
) -> ReportSummary:
    """Writes the report of an earlier run again from stored data.

    Args:
        record: Record of the run.
        service: Service that stores the run's resources.
        junit: Path for an additional JUnit XML report; None: none is written.
        markdown: Path for an additional Markdown report; None: none is written.

    Returns:
        Figures of the report, with the paths of the written files.

    Raises:
        OSError: A file cannot be written.
    """
    report, jobs, results = _gathered(record, service)
    report = _with_changes(_told_of_known(report, *with_known(record, jobs)), record)
    pages = pages_elsewhere(service.settings)
    path = _publish(report, jobs, results, record.run_dir, pages)
    summary = summarize(report, results, pages.url)
    if junit is not None:
        junit.write_bytes(junit_xml(summary))
    if markdown is not None:
        markdown.write_text(markdown_report(summary), encoding="utf-8")
    return summary.model_copy(update={"report_path": path, "junit_path": junit})


def _gathered(record: RunRecord, service: Service) -> tuple[Report, list[JobRecord], ResultTable]:
    """Returns a run's report, its jobs' records and the table of results; writes the table and why jobs failed."""
    report = report_of(record, service)
    places = places_of(report.jobs, service)
    jobs = job_records(report.jobs, places, service)
    results = write_results(jobs, places, service, record.run_dir)
    digests = {
        job.label: job.result.state_digest for job in report.jobs if job.result is not None and job.result.state_digest
    }
    report = report.model_copy(update={"axes": _axis_results(record, jobs, results, digests)})
    if record.challenge is not None:
        challenge = judged_challenge(record.challenge, report.jobs, jobs, results)
        report = report.model_copy(update={"challenge": challenge})
    else:  # sabotaged jobs fail because of their sabotage
        states = results.states_of(jobs, digests)
        stopped = _STOPPED if record.against else ""
        why = explain(results, refused=stopped, states=states, again=record.whole_again)
        if why is not None:
            why = why.model_copy(update={"parameters": record.parameters})
        effects = [] if record.against else axis_effects(results, why, states)
        report = report.model_copy(update={"why": why, "effects": effects})
    write_why(report.why, record.run_dir)
    return report, jobs, results


def _axis_results(
    record: RunRecord, jobs: Sequence[JobRecord], results: ResultTable, digests: Mapping[str, str]
) -> list[AxisResult]:
    """The results by the axes of the run's steps; empty if no job has axes or the run is a challenge."""
    if record.challenge is not None or not any(job.axes for job in jobs):
        return []
    from ..comparison.arms import axis_results  # imports scipy, which other runs do without

    run = replace(NightRun.of(record.model_copy(update={"jobs": list(jobs)})), table=results)
    return axis_results(run, digests)


def _told_of_known(report: Report, jobs: Sequence[JobRecord], notes: list[str]) -> Report:
    """Returns the report with the marks of known failures that the jobs' records have."""
    told = [job.model_copy(update={"known": short.known}) for job, short in zip(report.jobs, jobs, strict=True)]
    return report.model_copy(update={"jobs": told, "known_notes": notes})


def _state_of_challenge(of_steps: RunState, challenge: Challenge) -> RunState:
    """Returns the state of a challenge: that of its steps, since failures of sabotaged jobs are no failures of it."""
    if of_steps != "succeeded":
        return of_steps
    if challenge.is_broken:
        return "broken"
    return "succeeded" if challenge.is_passed else "failed"


def _with_changes(report: Report, record: RunRecord) -> Report:
    """Adds the changes since the last run to a report; a run that ended before its jobs has none, nor has a rerun."""
    if not is_night(record) or record.ended_before_jobs:
        return report
    return report.model_copy(update={"since_last": since_last(NightRun.of(record), record.run_dir.parent)})


def report_of(record: RunRecord, service: Service) -> Report:
    """Collects the report of an earlier run from the catalog and the object store; writes nothing."""
    reported = jobs_of(record.steps, service, record.rerun_of)
    return Report(
        name=record.name,
        run_id=record.run_id,
        state=record.state,
        started_at=record.started_at,
        ended_at=record.ended_at,
        steps=[_reported_step(step) for step in record.steps],
        worlds=_worlds(record.steps, reported, service),
        jobs=reported,
        command=record.whole_again,
        refusal=record.refusal or "",
        parameters=record.parameters,
        rerun_of=_rerun_in_words(record.rerun_of),
        forecast=record.forecast,
        versions=dict(record.versions),
        against=in_words(record.against) if record.against else "",
        stopped_early=record.against is not None and record.against.stopped_early,
        interrupted=interrupted_in_words(record.interruptions),
    )


def report_of_job(arn: str, service: Service) -> Report:
    """Makes a report of a single simulation job: its result, stored outputs and world.

    Args:
        arn: ARN of the job, which may still be running.
        service: Service that stores the job.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
    """
    resource = service.catalog.get(arn, kind="simulation-job")
    job = _reported_job(resource, service)
    return Report(
        name=job.title,
        run_id=SimulationJobDocument.of(resource).spec_run or "",
        state=run_state([job.status], []),
        started_at=resource.created_at,
        ended_at=resource.updated_at,
        steps=[],
        worlds=_worlds([], [job], service),
        jobs=[job],
        command=f"robomaker repro {job.label}",
    )


def report_of_world(arn: str, service: Service) -> Report:
    """Makes a report of a single world.

    Args:
        arn: ARN of the world.
        service: Service that stores the world.

    Raises:
        ResourceNotFoundException: The catalog has no such world.
        StorageError: The world's files cannot be downloaded.
    """
    resource = service.catalog.get(arn, kind="world")
    return Report(
        name=name_of_world(resource, service),
        run_id="",
        state="succeeded",
        started_at=resource.created_at,
        ended_at=resource.updated_at,
        steps=[],
        worlds=[_reported_world(resource, service, name_of_world(resource, service))],
        jobs=[],
        command=f"robomaker world view {arn}",
    )


def _publish(
    report: Report, records: Sequence[JobRecord], results: ResultTable, folder: Path, pages: ConsolePages
) -> Path:
    path = write_report(report, folder / REPORT_NAME, results)
    # Prefect, a second of CPU time to import, is there in a flow run only: `robomaker report` does without.
    if current_flow_run() is not None:
        _show(report, records, path, pages)
    return path


def jobs_of(
    steps: Sequence[StepRecord], service: Service, rerun_of: RerunOf | None = None, *, has_ended: bool = True
) -> list[ReportedJob]:
    """Lists the simulation jobs of a run's steps, and the requests without a job, in request order.

    Args:
        steps: Records of the run's steps.
        service: Service that stores the jobs.
        rerun_of: Run that was repeated, if the run is a rerun.
        has_ended: Whether the run has ended; before that, requests that still wait to become jobs are listed, too.
    """
    earlier = rerun_of.earlier if rerun_of else {}
    jobs: list[ReportedJob] = []
    for step in steps:
        if step.arn:
            try:
                made = simulation_jobs(step.operation, step.arn, service, has_ended=has_ended)
                before = earlier.get(step.name) or []
                told = before if len(before) == len(made) else [None] * len(made)
                jobs += [
                    job.model_copy(update={"step": step.name, "earlier": each})
                    for job, each in zip(made, told, strict=True)
                ]
            except ResourceNotFoundException as error:
                jobs.append(
                    ReportedJob(
                        label=short_name(step.arn),
                        step=step.name,
                        arn=step.arn,
                        status="Deleted",
                        failure_reason=str(error),
                    )
                )
    return told_of_twins(with_inputs(_with_owners(_with_names(jobs, steps, service), service), service))


def _with_names(jobs: Sequence[ReportedJob], steps: Sequence[StepRecord], service: Service) -> list[ReportedJob]:
    """Adds names that no other job of the run has, those of their worlds, and the settings in which requests differ."""
    worlds = _names_of_worlds(steps, jobs, service)
    in_worlds = [worlds.get(job.world_arn or "") for job in jobs]
    names = [job_name(job.application, world) or job.label for job, world in zip(jobs, in_worlds, strict=True)]
    settings = [{"step": job.step, **job.request} for job in jobs]
    requests = [job.request for job in jobs]
    named = zip(jobs, unique_job_names(names, settings), in_worlds, variants(requests), strict=True)
    return [
        job.model_copy(update={"name": name, "world_name": world, "variant": variant})
        for job, name, world, variant in named
    ]


def _names_of_worlds(steps: Sequence[StepRecord], jobs: Sequence[ReportedJob], service: Service) -> dict[str, str]:
    """Returns names of the worlds of a run that no two of them share, by ARN; deleted ones are called as jobs say."""
    arns = _arns_of_worlds(steps, jobs)
    said = {job.world_arn: job.world_name for job in jobs if job.world_arn and job.world_name}
    known = said | names_of_worlds(arns, service)
    return unique_world_names({arn: known.get(arn) or short_name(arn) for arn in arns})


def _with_owners(jobs: Sequence[ReportedJob], service: Service) -> list[ReportedJob]:
    """Adds to each reported job the process (machine, program) that ran it."""
    found = service.catalog.ownerships(job.arn for job in jobs if job.arn)
    owners = {arn: JobOwner.of_lease(ownership.owner) for arn, ownership in found.items() if ownership.owner}
    return [job.model_copy(update={"carried_out_by": owners.get(job.arn or "")}) for job in jobs]


def simulation_jobs(operation: str, arn: str, service: Service, *, has_ended: bool = True) -> list[ReportedJob]:
    """Lists the simulation jobs of a job or batch that an operation created; empty for other operations.

    Args:
        operation: The operation.
        arn: ARN of the job or batch.
        service: Service that stores the job or batch.
        has_ended: Whether the run has ended; before that, requests of a batch that still wait to become jobs are
            listed, too.

    Raises:
        ResourceNotFoundException: The job or batch was deleted.
    """
    if operation == "CreateSimulationJob":
        return _single_job(arn, service)
    return _batch_jobs(arn, service, has_ended=has_ended) if operation == "StartSimulationJobBatch" else []


def _single_job(arn: str, service: Service) -> list[ReportedJob]:
    return [_reported_job(service.catalog.get(arn, kind="simulation-job"), service)]


def _batch_jobs(arn: str, service: Service, *, has_ended: bool) -> list[ReportedJob]:
    document = SimulationJobBatchDocument.of(service.catalog.get(arn, kind="simulation-job-batch"))
    jobs = {
        SimulationJobDocument.of(job).request_index or 0: _reported_job(job, service)
        for job in service.catalog.children(arn, kind="simulation-job")
    }
    for place, failure in document.failed.items():
        jobs[int(place)] = _without_job(
            document.requests[int(place)], int(place), "NotCreated", failure.failure_reason, failure.failure_code
        )
    if not has_ended:
        for index, request in enumerate(document.requests):
            if index not in jobs:
                jobs[index] = _without_job(request, index, "Pending", "the request has not become a job yet")
    return [jobs[index] for index in sorted(jobs)]


def _without_job(
    request: Mapping[str, Any], index: int, status: str, reason: str | None, code: str | None = None
) -> ReportedJob:
    return ReportedJob(
        label=f"request {index + 1}",
        status=status,
        failure_code=code,
        failure_reason=reason,
        request=dict(request),
        world_arn=world_arn(request),
        application=application_name(request),
        inputs=inputs_of_request(request, None),
    )


def records_of_ended(step: str, jobs: Sequence[Resource], service: Service) -> tuple[list[JobRecord], ResultTable]:
    """Returns the short records of some jobs of a step that have ended, with the table of their results.

    Args:
        step: Step that created the jobs.
        jobs: The jobs.
        service: Service that stores their outputs.
    """
    reported = [_reported_job(job, service).model_copy(update={"step": step}) for job in jobs]
    reported = with_inputs(reported, service)
    places = places_of(reported, service)
    records = [_job_record(job, (job.label, ""), places.get(job.arn or ""), service) for job in reported]
    return records, results_of(records, service, places)


def _rerun_in_words(rerun_of: RerunOf | None) -> str:
    if rerun_of is None:
        return ""
    count, total = sum(map(len, rerun_of.earlier.values())), rerun_of.jobs_total
    return f"{rerun_of.run_id}: {count} of {total} {'job' if total == 1 else 'jobs'} ({rerun_of.selection})"


def installed_versions() -> dict[str, str]:
    """Returns the versions of the installed packages that influence results."""
    return {"python": platform.python_version()} | {name: importlib.metadata.version(name) for name in _PACKAGES}


def _reported_job(job: Resource, service: Service) -> ReportedJob:
    document = SimulationJobDocument.of(job)
    files, result, poster, removed = outputs_of(document.outputs, service)
    drawn = drawn_trial(document.outputs, result, files, service)
    duration = document.simulation_time_millis
    if result is None and document.verdict and job.status == "Completed":
        result = judged_without_outputs(document)
    if result is not None and job.status == "Canceled":
        result = result.unjudged()  # one that was cancelled after its manifest was written has a verdict there
    return ReportedJob(
        label=job.id,
        name=name_of_job(document),
        arn=job.arn,
        status=job.status,
        failure_code=document.failure_code,
        failure_reason=document.failure_reason,
        request=dict(document.request),
        world_arn=world_arn(document.request),
        world_name=document.world_name,
        application=application_name(document.request),
        seed=document.seed,
        result=result,
        drawn_trial=drawn[0] if drawn else None,
        drawn_result=drawn[1] if drawn else None,
        poster_png=poster,
        files=files,
        removed_files=removed,
        duration_s=None if duration is None else duration / 1000,
        waited_s=document.waited_s,
        video_s=document.video_s,
        upload_s=document.upload_s,
        reused_from=_origin(document.reused_from),
    )


def _origin(reused_from: ReusedFrom | None) -> str | None:
    """Returns the origin of reused results: the run, or the job if it belongs to no run."""
    return reused_from and (reused_from.spec_run or short_name(reused_from.job))


def job_records(jobs: Sequence[ReportedJob], places: Mapping[str, StoredPlace], service: Service) -> list[JobRecord]:
    """Makes the short records of reported jobs.

    Args:
        jobs: The jobs of a run.
        places: Places of the jobs' outputs, by ARN.
        service: Service that stores the jobs.
    """
    return [
        _job_record(job, names, places.get(job.arn or ""), service)
        for job, names in zip(jobs, case_names(jobs), strict=True)
    ]


def _job_record(job: ReportedJob, names: tuple[str, str], place: StoredPlace | None, service: Service) -> JobRecord:
    result = job.result
    test, case_name = names
    return JobRecord(
        arn=job.arn,
        label=job.label,
        name=job.name,
        variant=job.variant,
        status=job.status,
        verdict=result.verdict if result else None,
        world=job.world_arn and short_name(job.world_arn),
        world_name=job.world_name,
        rooms_visited=sum(room.visited for room in result.rooms) if result and result.rooms else None,
        rooms_total=len(result.rooms) if result and result.rooms else None,
        duration_s=job.duration_s,
        sim_time_s=(result.sim_time_s or None) if result else None,
        ended_by=result.ended_by if result else None,
        state_digest=result.state_digest if result else None,
        failure_code=job.failure_code,
        failure_reason=job.failure_reason,
        verdict_reason=result.reason if result else None,
        unnamed_failure=fails_besides(result),
        remarks=result.remarks if result else [],
        runs_free=result is not None and result.runs_free,
        metrics=result.metrics if result else {},
        output_uri=service.store.uri(place.bucket, place.prefix) if place else None,
        step=job.step,
        test=test,
        case_name=case_name,
        requirements=result.requirements if result else [],
        inputs=job.inputs,
        axes=job.axes,
        reused_from=job.reused_from,
        earlier=job.earlier,
        carried_out_by=job.carried_out_by,
    )


def _worlds(steps: Sequence[StepRecord], jobs: Sequence[ReportedJob], service: Service) -> list[ReportedWorld]:
    """Returns the worlds that steps created or jobs used, each once, without those deleted or not readable."""
    names = _names_of_worlds(steps, jobs, service)
    worlds = []
    for arn in _arns_of_worlds(steps, jobs):
        try:
            worlds.append(_reported_world(service.catalog.get(arn, kind="world"), service, names[arn]))
        except (ResourceNotFoundException, StorageError):
            continue  # deleted since; the job's card says which world it was
    return worlds


def _arns_of_worlds(steps: Sequence[StepRecord], jobs: Sequence[ReportedJob]) -> list[str]:
    made = [
        arn
        for step in steps
        if step.operation == "CreateWorldGenerationJob"
        for arn in step.output.get("finishedWorldsSummary", {}).get("succeededWorlds", [])
    ]
    return list(dict.fromkeys([*made, *(job.world_arn for job in jobs if job.world_arn)]))


def _reported_world(world: Resource, service: Service, name: str) -> ReportedWorld:
    folder = world_bundle(world, service)
    return ReportedWorld(
        arn=world.arn,
        label=short_name(world.arn),
        name=name,
        world_json=folder / "world.json",
        floorplan_svg=(folder / "floorplan.svg").read_text(),
        preview_png=preview_of(world, service),
    )


def _reported_step(step: StepRecord) -> ReportedStep:
    duration = (step.ended_at - step.started_at).total_seconds() if step.started_at and step.ended_at else 0.0
    return ReportedStep(
        name=step.name,
        operation=step.operation,
        status=step.status,
        duration_s=duration,
        detail=step.error or step.arn or "",
    )


def _in_a_line(job: JobRecord, pages: ConsolePages) -> str:
    page = pages.job(job.arn)
    name = f"[{job.title}]({page})" if page else job.title_with_id
    return f"**{name}** {job.verdict or job.status}: {job.failure_code or ''} {job.failure_reason or ''}".rstrip()


def _show(report: Report, jobs: Sequence[JobRecord], path: Path, pages: ConsolePages) -> None:
    # Imported late: the console, which only reads, does not need Prefect.
    from ..execution.prefect_artifacts import artifact_key, show_picture, show_table, show_text

    rows: list[dict[str, Any]] = [
        {
            "job": job.title,
            "id": job.label,
            "setting": job.variant,
            "status": job.status,
            "verdict": job.verdict or "",
        }
        | {name: round(value, 2) for name, value in job.metrics.items()}
        for job in jobs
    ]
    show_table(artifact_key("robomaker", report.run_id, "jobs"), rows, "Simulation jobs")
    outcomes = [classify(job.status, job.failure_code, job.verdict) for job in jobs]
    passed = f"{passed_of(outcomes.count(Outcome.PASSED), len(jobs), 'job')}."
    state = state_in_words(report.state, Counter(each.value for each in outcomes))
    lines = [f"# {report.name}: {state}", "", passed, "", f"Report: `{path}`"]
    if page := pages.run(report.run_id):
        lines += ["", f"[Run in the console]({page})"]
    lines.append("")
    lines += [
        f"- {_in_a_line(job, pages)}"
        for job, outcome in zip(jobs, outcomes, strict=True)
        if outcome is not Outcome.PASSED
    ]
    if report.since_last and (lost := losses_in_words(report.since_last, _MOST_LOST)):
        lines += ["", *(f"- {line}" for line in lost)]
    show_text(artifact_key("robomaker", report.run_id, "summary"), "\n".join(lines), "How the run ended")
    for world in report.worlds[:1]:
        show_picture(artifact_key("robomaker", report.run_id, "world"), world.preview_png, world.title)
    tell_of_report(report.run_id, report.state, path, Counter(job.verdict or job.status for job in jobs))
