"""Converts the result of a run to the state of its flow run in Prefect, and that state back to a response.

| the run | Prefect's state |
| --- | --- |
| succeeded | `Completed` |
| failed (a verdict is FAIL) | `Failed`; `Completed` where `ROBOMAKER_VERDICT_FAILS_RUN` is 0 |
| broken | `Failed` |
| timed out | `TimedOut`, which is of the type `FAILED` |
| canceled, interrupted | `Cancelled` |
"""

import logging
import os
import signal
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from typing import Any, cast

import httpx
from prefect.client.orchestration import get_client
from prefect.client.schemas.objects import State
from prefect.context import FlowRunContext
from prefect.exceptions import PrefectException, TerminationSignal
from prefect.states import Cancelled, Completed, Failed

from ...schemas.reports.run_exit_codes import EXIT_CODES
from ...schemas.reports.run_states import FlowResult
from ...schemas.wire.errors import RobomakerError

RESULT = "result"
"""Key in a job flow's response under which its `FlowResult` is, beside the members of the job's description."""

_logger = logging.getLogger(__name__)


class RunNotSucceeded(RobomakerError):
    """Raised as the result of a flow whose run or job did not succeed; the message has the worst failures.

    Args:
        result: Result of the run or job.
        answer: Result that the flow would have returned in a good state.
    """

    def __init__(self, result: FlowResult, answer: Mapping[str, Any]) -> None:
        super().__init__(result, answer)
        self.result = result
        self.answer = dict(answer)
        self.exit_code = EXIT_CODES[result.state]

    def __str__(self) -> str:
        return self.result.message


def _in_one_line(record: logging.LogRecord) -> bool:
    """Log filter: removes the traceback of errors that have a message for users.

    A robot that misses its requirements, or a request that is refused, is no fault of a program; tracebacks of every
    night in a worker's log would hide those that are.
    """
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, RobomakerError):
        told = str(error)
        if isinstance(error, RunNotSucceeded) and record.name == "prefect.engine":
            # The engine ends with the error of a run whose state, with all the reasons, has just been logged.
            told = f"{error.result.state}; the reasons are above"
        record.msg, record.args = "%s: %s", (type(error).__name__, told)
        record.exc_info = record.exc_text = None
    return True


# Through these Prefect says that a flow or a task raised something.
for _name in ("prefect.engine", "prefect.flow_runs", "prefect.task_runs"):
    logging.getLogger(_name).addFilter(_in_one_line)


def end_state(result: FlowResult, answer: Mapping[str, Any] | None, *, verdict_fails_run: bool) -> State[Any]:
    """Makes the Prefect state in which a flow ends, from the result of its run or job.

    Args:
        result: Result of the run or job.
        answer: The job's final description, which is returned with the result as a further member; `None`: the flow
            of a specification, which returns the result alone.
        verdict_fails_run: Whether a verdict FAIL makes it a failed one.
    """
    told = result.model_dump(mode="json", exclude_none=True)
    data = told if answer is None else {**answer, RESULT: told}
    if result.state == "succeeded" or (result.state == "failed" and not verdict_fails_run):
        return Completed(message=result.message, data=data)
    error = RunNotSucceeded(result, data)
    if result.state == "canceled":
        return Cancelled(message=result.message, data=error)
    name = "TimedOut" if result.state == "timed out" else "Failed"
    return Failed(name=name, message=result.message, data=error)


def answer_of(state: State[Any]) -> tuple[dict[str, Any], FlowResult]:
    """Returns a finished Prefect flow's response (the job's description) and result, also if the job failed.

    Raises:
        BaseException: The error that the flow raised instead.
    """
    outcome: Any = state.result(raise_on_failure=False)
    if isinstance(outcome, RunNotSucceeded):
        outcome = outcome.answer
    elif isinstance(outcome, BaseException):
        raise outcome
    answer = cast("dict[str, Any]", outcome)
    members = {name: value for name, value in answer.items() if name != RESULT}
    return members, FlowResult.model_validate(answer[RESULT])


@contextmanager
def ends_as_cancelled() -> Generator[None]:
    """Marks the running flow as `Cancelled` in Prefect if Ctrl-C or SIGTERM interrupts the `with` block.

    The interruption is raised again. Prefect itself would say `Crashed`, which automations take for an accident. A
    Prefect worker sees to the states of the flow runs that it starts, so those are left alone.
    """
    try:
        yield
    except (KeyboardInterrupt, TerminationSignal) as interruption:
        context = FlowRunContext.get()
        if context is not None and not started_by_worker():
            _say_cancelled(context, interruption)
        raise


def started_by_worker() -> bool:
    """Whether a Prefect worker, or `serve` of a flow, started this process for one flow run.

    Child processes inherit its variables, so they are told apart by their main module.
    """
    main = getattr(sys.modules["__main__"], "__spec__", None)
    return "PREFECT__FLOW_RUN_ID" in os.environ and main is not None and main.name.startswith("prefect.")


def _say_cancelled(context: FlowRunContext, interruption: BaseException) -> None:
    number = interruption.signal if isinstance(interruption, TerminationSignal) else signal.SIGINT
    number = getattr(interruption, "signal_number", number)
    state: State[Any] = Cancelled(message=f"interrupted by {signal.Signals(number).name}; what it ran was cancelled")
    if context.flow_run is None:
        return
    try:
        with get_client(sync_client=True) as client:
            client.set_flow_run_state(context.flow_run.id, state, force=True)
    except (httpx.HTTPError, PrefectException) as error:
        _logger.warning("Prefect is not told that the run was interrupted: %s", error)
    else:
        # A run whose state is final is not made `Crashed`; its result is the interruption, which so reaches callers.
        state.data = interruption
        context.flow_run.state = state
