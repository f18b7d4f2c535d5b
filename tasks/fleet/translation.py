"""Translation of hawkBit feedback on orders into events of a rollout.

Our agent says why an order failed, by the numbers of `agent.failure_codes`. Updaters of others do not, so it is told
from what was said before:

| what the robot said | event |
| --- | --- |
| it read its order | `Fetched` |
| it proceeds | `Progressed`; the first detail may name the step |
| `Installed Chunk.`, which is SWUpdate's | `Progressed`, ExecutingPostLaunch: a health check is to say how it went |
| closed, success, after it proceeded | `Succeeded` |
| closed, success, without | `Failed`, RobotDeploymentAborted: nothing was installed |
| closed, failure, with a number of ours | `Failed`, with that code |
| closed, failure, before it was installed | `Failed`, ExtractingBundleFailure, or what kept the file from the robot |
| closed, failure, afterwards | `Failed`, PostLaunchFileFailure |
| canceled, or the cancellation closed | `Canceled` |
| the cancellation rejected | `CancelRefused` |

SWUpdate's last message does not say why it failed; `ERROR : …` among the details of those before does.
"""

from dataclasses import dataclass, replace
from typing import cast, get_args

from ...schemas.operations.deployment_jobs import RobotDeploymentStep
from ...schemas.rollouts.events import (
    Canceled,
    CancelRefused,
    Failed,
    Fetched,
    Progressed,
    Report,
    ReportedCode,
    Succeeded,
)
from .agent.failure_codes import NAMES
from .ddi.feedback import Execution, Feedback, OrderEnd
from .ddi.reports import CancelFeedback, OrderFeedback, OrderFetched

OrderReport = OrderFetched | OrderFeedback | CancelFeedback

_INSTALLED = ("Installed Chunk", "All Chunks Installed")
_SKIPPED = "Skipped Update"
_ERROR = "ERROR"
_KEPT_ERRORS = 3
_STEPS: frozenset[str] = frozenset(get_args(get_args(RobotDeploymentStep)[0]))


@dataclass(frozen=True)
class SaidBefore:
    """Summary of earlier feedback on an order, as far as the next event depends on it."""

    proceeded: bool = False
    installed: bool = False
    errors: tuple[str, ...] = ()
    """The last ones, oldest first."""

    withheld: ReportedCode | None = None
    """Why the server could not send the file, when the robot asked for it last."""


def heard(before: SaidBefore, feedback: Feedback) -> SaidBefore:
    """Adds a feedback to the summary of an order's feedback."""
    errors = [text.removeprefix(_ERROR).lstrip(" :") for text in feedback.details if text.startswith(_ERROR)]
    return replace(
        before,
        proceeded=before.proceeded or feedback.order_end is None,
        installed=before.installed or any(text.startswith(_INSTALLED) for text in feedback.details),
        errors=(*before.errors, *errors)[-_KEPT_ERRORS:],
    )


def event_of(report: OrderReport, robot: str, known: SaidBefore) -> Report:
    """Translates a report of a robot into an event of its rollout.

    Args:
        report: what the robot said.
        robot: its ARN; reports have the robot's own id.
        known: what is known of the order, with this report (`heard`).
    """
    if isinstance(report, OrderFetched):
        return Fetched(robot=robot, action_id=report.action_id)
    feedback = report.feedback
    if isinstance(report, CancelFeedback):
        return _answer_to_cancellation(feedback, robot)
    match feedback.order_end:
        case None:
            return _progress(feedback, robot, known)
        case OrderEnd.CANCELED:
            return Canceled(robot=robot, action_id=feedback.action_id)
        case OrderEnd.FAILED:
            return _failure(feedback, robot, known)
        case OrderEnd.FINISHED:
            return _success(feedback, robot, known)


def _answer_to_cancellation(feedback: Feedback, robot: str) -> Report:
    if feedback.cancel_end is not None:
        return Canceled(robot=robot, action_id=feedback.action_id)
    if feedback.execution is Execution.REJECTED:
        return CancelRefused(robot=robot, action_id=feedback.action_id)
    return Progressed(robot=robot, action_id=feedback.action_id)


def _progress(feedback: Feedback, robot: str, known: SaidBefore) -> Progressed:
    said = next((text for text in feedback.details[:1] if text in _STEPS), None)
    step: str | None = said
    if step is None and feedback.execution in (Execution.PROCEEDING, Execution.DOWNLOAD):
        step = "ExecutingPostLaunch" if known.installed else "DownloadingExtracting"
    percent = None
    # SWUpdate counts the file as one part; how much of it was sent is known better here.
    if step == "DownloadingExtracting" and feedback.count is not None and (feedback.of or 0) > 1:
        percent = min(100.0, 100.0 * feedback.count / (feedback.of or 1))
    return Progressed.model_validate(
        {"robot": robot, "action_id": feedback.action_id, "step": step, "percent_done": percent}
    )


def _failure(feedback: Feedback, robot: str, known: SaidBefore) -> Failed:
    if (said := _code(feedback)) is not None:
        texts = [text for text in feedback.details if text not in _STEPS]
        return Failed(robot=robot, action_id=feedback.action_id, code=said, reason="; ".join(texts) or None)
    if known.installed:  # what it complained of before did not keep it from installing
        code: ReportedCode = "PostLaunchFileFailure"
        reason = "; ".join(feedback.details or known.errors)
    else:  # SWUpdate ends each of these with the same words
        code = known.withheld or "ExtractingBundleFailure"
        reason = "; ".join(known.errors or feedback.details)
    return Failed(robot=robot, action_id=feedback.action_id, code=code, reason=reason or None)


def _code(feedback: Feedback) -> ReportedCode | None:
    """The failure code that an agent of ours said; numbers of others mean nothing here."""
    return cast("ReportedCode | None", NAMES.get(feedback.code or 0))


def _success(feedback: Feedback, robot: str, known: SaidBefore) -> Report:
    if known.proceeded and not any(text.startswith(_SKIPPED) for text in feedback.details):
        return Succeeded(robot=robot, action_id=feedback.action_id)
    said = f" ({'; '.join(feedback.details)})" if feedback.details else ""
    reason = f"the robot closed its order as a success and had installed nothing{said}"
    return Failed(robot=robot, action_id=feedback.action_id, code="RobotDeploymentAborted", reason=reason)
