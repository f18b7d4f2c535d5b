from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.programs import RunStop
from prefect_robomaker.tasks.runtime.episode.progress import STOP_REASONS, Phase, Progress
from prefect_robomaker.tasks.runtime.supervision.run_outcomes import Crash, Exit, decide_outcome, failure_reason

Plan = Callable[..., RunPlan]
FINISHED = Exit(0, None, Phase.FINISHING, {"ended_by": "environment"})


@given(
    st.text(max_size=2000),
    st.lists(st.text(st.characters(exclude_categories=["Cc", "Zl", "Zp"]), max_size=2000), max_size=30),
)
def test_reasons_fit_and_end_with_the_log(head: str, lines: list[str]) -> None:
    reason = failure_reason(head, "logs/stderr.log", lines)
    assert len(reason) <= 1024
    if lines:
        assert reason.endswith(lines[-1][-300:])


def test_short_logs_are_whole() -> None:
    assert failure_reason("It broke.", "log", ["one", "two"]) == "It broke.\nLast lines of log:\none\ntwo"
    assert failure_reason("It broke.", "log", []) == "It broke."


def test_a_last_line_that_is_too_long_keeps_its_beginning_and_its_end() -> None:
    reason = failure_reason("It broke.", "log", ["Traceback", f"KeyError: no {'x' * 3000} here"])
    assert reason.startswith("It broke.\nLast lines of log:\nKeyError: no xxx")
    assert reason.endswith("xxx here")
    assert len(reason) <= 1024


def test_a_request_that_cannot_be_done_is_not_the_runtimes_failure(make_plan: Plan) -> None:
    refused = {"error": "requirement near: there is no body 'cat'", "phase": Phase.JUDGING, "code": "InvalidInput"}
    outcome = decide_outcome(Exit(1, None, Phase.JUDGING, refused), None, make_plan())
    assert (outcome.failure_code, outcome.failure_reason) == ("InvalidInput", refused["error"])


def test_a_sentence_that_the_log_has_too_is_told_once(make_plan: Plan) -> None:
    error = "robot.yaml:4:3: base: the model has no 'bse'"
    refused = Exit(
        1, None, Phase.MAKE_ENVIRONMENT, {"error": error, "phase": 1, "code": "InvalidBundleRobotApplication"}
    )
    log = ("logs/stderr.log", [error])
    text = f"Robot application driver has no robot that can be used: {error}"
    assert decide_outcome(refused, None, make_plan(), log).failure_reason == text
    more = ("logs/stderr.log", ["hull.dae is not shown", error])
    told = decide_outcome(refused, None, make_plan(), more).failure_reason
    assert told == f"{text}\nLast lines of logs/stderr.log:\nhull.dae is not shown"


@pytest.mark.parametrize("stopped_for", [RunStop.DURATION_LIMIT, RunStop.CANCELED])
def test_an_end_just_before_the_stop_counts(make_plan: Plan, stopped_for: RunStop) -> None:
    outcome = decide_outcome(FINISHED, stopped_for, make_plan())
    assert (outcome.status, outcome.timed_out) == ("Completed", False)


def test_a_crash_while_stopping_is_a_stop(make_plan: Plan) -> None:
    crashed = Exit(1, None, Phase.STEP, {"error": "boom", "phase": Phase.STEP})
    assert decide_outcome(crashed, RunStop.CANCELED, make_plan()).status == "Canceled"
    assert decide_outcome(crashed, RunStop.DURATION_LIMIT, make_plan()).timed_out


@pytest.mark.parametrize(
    ("phase", "code", "text"),
    [
        (Phase.RESET, "SimulationApplicationCrash", "Simulation application arena failed in environment.reset()"),
        (Phase.STEP, "SimulationApplicationCrash", "Simulation application arena failed in environment.step()"),
        (Phase.AGENT, "RobotApplicationCrash", "Robot application driver failed in the agent"),
        (Phase.FINISHING, "InternalServiceError", "The runtime failed in writing the outputs"),
        (Phase.STARTING, "InternalServiceError", "The runtime failed in starting the run"),
    ],
)  # fmt: skip
def test_whose_signal_it_was(make_plan: Plan, phase: Phase, code: str, text: str) -> None:
    outcome = decide_outcome(Exit(None, 11, phase, {}), None, make_plan())
    assert outcome.failure_code == code
    assert outcome.failure_reason == f"{text}: killed by SIGSEGV"


def test_a_failure_during_the_run_says_when_it_was(make_plan: Plan) -> None:
    crashed = Exit(None, None, Phase.AGENT, {}, Crash("robot", "exited with code 1", "robot"), sim_time_s=3.04)
    raised = Exit(1, None, Phase.AGENT, {"error": "lost", "phase": Phase.AGENT}, sim_time_s=3.04)
    closing = Exit(1, None, Phase.REPORT, {"error": "lost", "phase": Phase.REPORT}, sim_time_s=3.04)
    assert [decide_outcome(each, None, make_plan()).failure_reason for each in (crashed, raised, closing)] == [
        "Robot application driver (program robot) exited with code 1 after 3.0 s simulated",
        "Robot application driver failed in the agent after 3.0 s simulated: lost",
        "Simulation application arena failed in environment.run_result(): lost",
    ]


def test_a_success_that_was_not_finished_is_a_failure(make_plan: Plan) -> None:
    outcome = decide_outcome(Exit(0, None, Phase.AGENT, {}), None, make_plan())
    assert outcome.failure_code == "RobotApplicationCrash"
    assert "ended itself with exit code 0 before the run was over" in (outcome.failure_reason or "")


def test_a_vanished_supervisor_is_no_fault_of_an_application(make_plan: Plan) -> None:
    assert decide_outcome(None, None, make_plan()).failure_code == "InternalServiceError"


def test_progress_says_what_was_written() -> None:
    progress = Progress()
    assert (progress.phase, progress.stop_reason, progress.read_report()) == (Phase.STARTING, "", {})
    for phase in Phase:
        progress.mark(phase)
        assert progress.phase is phase
        assert phase.activity
    for reason in STOP_REASONS:
        progress.request_stop(reason)
        assert progress.stop_reason == reason
    progress.write_report({"error": "ä" * 1000})
    assert progress.read_report() == {"error": "ä" * 1000}
    with pytest.raises(ValueError, match="does not fit"):
        progress.write_report({"error": "x" * 70_000})
