"""Figures of a run's report: rates, counts and times."""

from ...schemas.reports.report import JobCase, Report, ReportedJob, ReportedStep, ReportSummary, StepSuite
from ...schemas.reports.run_record import JobRecord
from ...schemas.reports.run_states import plain_reason
from ..results import rates
from ..results.table import ResultTable
from . import outcomes
from .case_names import lasting_titles, named_cases
from .outcomes import Outcome, count_outcomes, outcome_of
from .worlds import trials_share


def summarize(report: Report, results: ResultTable | None = None, console_url: str = "") -> ReportSummary:
    """Computes the numbers of a run's report: pass rates, counts and times.

    Args:
        report: Report with jobs and steps.
        results: Table of results of the report's trials; None: each job is one trial.
        console_url: URL of the console for other machines; empty: unknown.
    """
    results = results or _results_of(report)
    labels = {world.arn: world.title for world in report.worlds}
    return ReportSummary(
        name=report.name,
        run_id=report.run_id,
        state=report.state,
        started_at=report.started_at,
        time_s=(report.ended_at - report.started_at).total_seconds(),
        counts={outcome.value: count for outcome, count in count_outcomes(report.jobs).items()},
        trials=len(results),
        success=rates.of_table("", results),
        success_with_errors=rates.of_table("", results, errors_fail=True),
        requirements=rates.by_requirement(results),
        worlds=rates.by_world(results),
        rooms=rates.by_room(report.jobs),
        since_last=report.since_last,
        parameters=report.parameters,
        rerun_of=report.rerun_of,
        against=report.against,
        stopped_early=report.stopped_early,
        forecast=report.forecast,
        challenge=report.challenge,
        axes=report.axes,
        effects=report.effects,
        why=report.why,
        console_url=console_url,
        steps=[suite for step in report.steps if (suite := _suite(step, report, labels)).jobs or suite.error],
    )


def _results_of(report: Report) -> ResultTable:
    """Makes a table of results from a report's jobs, each as one trial."""
    labels = {world.arn: world.title for world in report.worlds}
    return ResultTable.of(
        [
            JobRecord(
                label=job.label,
                name=job.name,
                status=job.status,
                verdict=job.result.verdict if job.result else None,
                failure_code=job.failure_code,
                world=labels.get(job.world_arn, job.world_arn) if job.world_arn else None,
                requirements=job.result.requirements if job.result else [],
                inputs=job.inputs,
            )
            for job in report.jobs
        ]
    )


def why_broken(job: ReportedJob) -> str:
    """Returns the reason why a job did not pass: its failure's reason, missed requirements or summary; else empty."""
    if job.failure_reason:
        return outcomes.plain(job.failure_reason)
    if job.result is None:
        return ""
    return plain_reason(job.result.reason or "") or job.result.summary


def folder_of(job: ReportedJob) -> str:
    """Returns the URL prefix common to all of a job's files; empty if there is none."""
    folders = {file.uri.removesuffix(file.name) for file in job.files if file.uri.endswith(file.name)}
    return folders.pop() if len(folders) == 1 else ""


def _suite(step: ReportedStep, report: Report, labels: dict[str, str]) -> StepSuite:
    own = [job for job in report.jobs if job.step == step.name]
    named = [(title, *each) for title, each in zip(lasting_titles(own), named_cases(own), strict=True)]
    jobs = sorted(named, key=lambda each: not outcome_of(each[2]).is_failure)
    has_failed = step.status.endswith("Failed") and not jobs
    return StepSuite(
        name=step.name,
        operation=step.operation,
        status=step.status,
        error=(step.detail or step.status) if has_failed else "",
        time_s=step.duration_s,
        jobs=[_case(job, test, title, labels) for title, test, job in jobs],
    )


def _case(job: ReportedJob, test: str, title: str, labels: dict[str, str]) -> JobCase:
    outcome, result = outcome_of(job), job.result
    return JobCase(
        name=job.label,
        title=job.name,
        test=test,
        case_name=title,
        arn=job.arn,
        outcome=outcome.value,
        reason="" if outcome is Outcome.PASSED else why_broken(job),
        known=job.known,
        failure_code=job.failure_code,
        time_s=job.duration_s or 0.0,
        waited_s=job.waited_s,
        sim_time_s=result.sim_time_s if result else None,
        seed=result.seed if result else job.seed,
        world=labels.get(job.world_arn, job.world_arn) if job.world_arn else None,
        output=folder_of(job) or None,
        requirements=result.requirements if result else [],
        remarks=result.remarks if result else [],
        tools=result.tools if result else [],
        metrics=result.metrics if result else {},
        trials=trials_share(job),
        reused_from=job.reused_from,
        earlier=job.earlier,
    )
