"""Sums add up: whatever the jobs of a run come to, each place that counts them counts every job once."""

import re
from datetime import timedelta

from helpers.night_records import FIRST_NIGHT, make_job, make_night
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue] - compiled, without types

from prefect_robomaker.schemas.reports.report import Report, ReportedJob, ReportedStep
from prefect_robomaker.schemas.reports.run_exit_codes import EXIT_CODES
from prefect_robomaker.schemas.reports.run_record import JobRecord, RunState
from prefect_robomaker.schemas.reports.run_states import count_outcomes, counts_in_words, outcomes_in_words, run_state
from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.tasks.notifications.notification_texts import message_of
from prefect_robomaker.tasks.reporting import junit_xml, summarize
from prefect_robomaker.tasks.reporting.outcomes import headline

ENDS = st.fixed_dictionaries(
    {
        "status": st.sampled_from(
            ["Completed", "Failed", "RunningFailed", "Canceled", "Terminated", "Running", "NotCreated"]
        ),
        "verdict": st.sampled_from(["PASS", "FAIL", "ERROR", "NONE", None]),
        "failure_code": st.sampled_from([None, None, "RobotApplicationCrash", "BatchTimedOut", "BatchCanceled"]),
    }
)  # fmt: skip


@given(st.lists(ENDS, min_size=1, max_size=12))
def test_every_place_counts_each_job_once(ends: list[dict[str, str | None]]) -> None:
    jobs = [make_job(number, "P").model_copy(update={**each, "requirements": []}) for number, each in enumerate(ends)]
    counts, state = count_outcomes(jobs), run_state([], jobs)
    assert sum(counts.values()) == len(jobs)

    # The line at the end of a run, the state of its flow, the message of a batch.
    told = counts_in_words(jobs)
    assert summed(told, r"\d+ of (\d+) jobs?") == len(jobs)
    named = summed(told, r"(\d+)(?: of \d+ jobs? passed| broke| canceled| unfinished| without)")
    assert named + counts.get("failed", 0) == len(jobs), "those that are not named failed"
    outcomes = [outcome for outcome, count in counts.items() for _ in range(count)]
    assert summed(outcomes_in_words(outcomes).partition(": ")[2], r"(\d+) [a-z]") == len(jobs)

    # The report, its numbers, and JUnit.
    report = _report(jobs, state)
    summary = summarize(report)
    assert (summary.counts, summary.trials) == (counts, len(jobs))
    words = "passed|broken|failed|canceled|unfinished|no verdict"
    assert summed(headline(report), rf"(\d+)(?: of \d+ jobs?)? (?:{words})") == len(jobs)
    suite = etree.fromstring(junit_xml(summary))[0]
    assert int(suite.get("tests")) == len(jobs)
    ended = sum(int(suite.get(name)) for name in ("failures", "errors", "skipped"))
    assert ended + counts.get("passed", 0) == len(jobs)

    # The notification.
    record = make_night(jobs).model_copy(update={"state": state, "exit_code": EXIT_CODES[state]})
    title = message_of(record, None).title
    assert summed(
        title, r"(\d+)(?: of \d+ jobs? passed| failed| broke| canceled| unfinished| without a verdict)\b"
    ) == len(jobs)


def summed(text: str, pattern: str) -> int:
    return sum(map(int, re.findall(pattern, text)))


def _report(jobs: list[JobRecord], state: RunState) -> Report:
    reported = [
        ReportedJob(
            label=job.label, arn=job.arn, status=job.status, failure_code=job.failure_code, step="drive",
            result=job.verdict and RunResult(verdict=job.verdict, sim_time_s=1, wall_time_s=1, real_time_factor=1,
                                             ended_by="agent", seed=1),
        )
        for job in jobs
    ]  # fmt: skip
    step = ReportedStep(name="drive", operation="StartSimulationJobBatch", status="Completed", duration_s=1)
    return Report(
        name="night", run_id="night-1", state=state, started_at=FIRST_NIGHT,
        ended_at=FIRST_NIGHT + timedelta(seconds=1), steps=[step], worlds=[], jobs=reported, command="",
    )  # fmt: skip
