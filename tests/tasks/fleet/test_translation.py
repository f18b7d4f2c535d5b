"""What robots say, in hawkBit's words, as events of a rollout."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    Canceled,
    CancelRefused,
    Failed,
    Fetched,
    Progressed,
    Report,
    Succeeded,
)
from prefect_robomaker.tasks.fleet.agent.errors import NUMBERS
from prefect_robomaker.tasks.fleet.ddi.received_reports import (
    CancelFeedback,
    Execution,
    Feedback,
    Finished,
    OrderFeedback,
    OrderFetched,
)
from prefect_robomaker.tasks.fleet.order_keeping import SaidBefore, event_of, heard

ROBOT = "arn:robot"


def said(execution: str, *details: str, finished: str = "none", **members: int) -> Feedback:
    return Feedback(8, Execution(execution), Finished(finished), details=details, **members)


def told(*feedbacks: Feedback, before: SaidBefore | None = None) -> list[Report]:
    """The events of what a robot says of its order, one after the other."""
    known, events = before or SaidBefore(), []
    for feedback in feedbacks:
        known = heard(known, feedback)
        events.append(event_of(OrderFeedback("rover", feedback, 1.0), ROBOT, known))
    return events


SUCCESS = said("closed", "health ok", finished="success")
FAILURE = said("closed", "No suitable .swu image found", finished="failure")
INSTALLED = said("proceeding", "Installed Chunk.", count=1, of=1)


def test_what_swupdate_says_when_all_is_well() -> None:
    begun = said("proceeding", "Installing Update Chunk Artifacts.", count=0, of=1)

    events = told(begun, INSTALLED, said("proceeding", "All Chunks Installed."), SUCCESS)

    steps = ["DownloadingExtracting", "ExecutingPostLaunch", "ExecutingPostLaunch"]
    assert [event.step for event in events if isinstance(event, Progressed)] == steps
    assert [event.percent_done for event in events if isinstance(event, Progressed)] == [None] * 3
    assert events[-1] == Succeeded(robot=ROBOT, action_id=8)
    fetched = event_of(OrderFetched("rover", 8, 1.0), ROBOT, SaidBefore())
    assert fetched == Fetched(robot=ROBOT, action_id=8)


def test_a_failure_is_told_by_the_errors_that_came_before() -> None:
    errors = said("proceeding", "ERROR : cannot read sw-description", "retrying", "ERROR : bad signature")

    assert told(errors, FAILURE)[-1] == Failed(
        robot=ROBOT,
        action_id=8,
        code="ExtractingBundleFailure",
        reason="cannot read sw-description; bad signature",
    )


def test_complaints_before_it_installed_are_not_why_a_health_check_failed() -> None:
    complaint = said("proceeding", "ERROR : Cannot read stored update state.")
    ill = said("closed", "health check failed", finished="failure")

    *_, failed = told(complaint, INSTALLED, complaint, ill)
    assert isinstance(failed, Failed)
    assert (failed.code, failed.reason) == ("PostLaunchFileFailure", "health check failed")
    *_, wordless = told(complaint, INSTALLED, said("closed", finished="failure"))
    assert isinstance(wordless, Failed)
    assert wordless.reason == "Cannot read stored update state."


@pytest.mark.parametrize(
    ("before", "code"),
    [
        (SaidBefore(), "ExtractingBundleFailure"),
        (SaidBefore(withheld="BadPermissionError"), "BadPermissionError"),
        (SaidBefore(installed=True), "PostLaunchFileFailure"),
    ],
)
def test_when_it_failed_decides_the_code(before: SaidBefore, code: str) -> None:
    (event,) = told(FAILURE, before=before)
    assert isinstance(event, Failed)
    assert (event.code, event.reason) == (code, "No suitable .swu image found")


@pytest.mark.parametrize("finished", ["success", "none"])
def test_a_success_of_which_nothing_was_heard_before_is_none(finished: str) -> None:
    (event,) = told(said("closed", finished=finished))
    assert isinstance(event, Failed)
    assert event.code == "RobotDeploymentAborted"
    skipped = said("closed", "Skipped Update.", finished=finished)
    assert isinstance(told(said("proceeding"), skipped)[-1], Failed)
    assert isinstance(told(said("proceeding"), said("closed", finished=finished))[-1], Succeeded)


def test_parts_are_counted_and_steps_named_by_robots_that_do() -> None:
    counted, named, unknown = told(
        said("download", count=3, of=12), said("proceeding", "ExecutingPreLaunch"), said("resumed", count=3, of=12)
    )
    assert counted == Progressed(robot=ROBOT, action_id=8, step="DownloadingExtracting", percent_done=25.0)
    assert named == Progressed(robot=ROBOT, action_id=8, step="ExecutingPreLaunch")
    assert unknown == Progressed(robot=ROBOT, action_id=8)


@pytest.mark.parametrize(
    ("answer", "event"),
    [
        (said("closed", finished="success"), Canceled),
        (said("closed", finished="failure"), Canceled),
        (said("canceled"), Canceled),
        (said("rejected"), CancelRefused),
        (said("proceeding"), Progressed),
    ],
)
def test_answers_to_a_cancellation(answer: Feedback, event: type[Report]) -> None:
    assert type(event_of(CancelFeedback("rover", answer, 1.0), ROBOT, SaidBefore(True, True))) is event


FEEDBACKS = st.builds(
    Feedback,
    st.just(8),
    st.sampled_from(Execution),
    st.sampled_from(Finished),
    st.none() | st.integers(0, 9),
    st.none() | st.integers(0, 9),
    st.none(),
    st.lists(
        st.sampled_from(["Installed Chunk.", "ERROR : x", "Launching", "Skipped Update.", ""]) | st.text(), max_size=3
    ).map(tuple),
)


@given(st.lists(FEEDBACKS, max_size=6))
def test_whatever_is_said_ends_the_order_exactly_where_the_door_ends_it(feedbacks: list[Feedback]) -> None:
    for feedback, event in zip(feedbacks, told(*feedbacks), strict=True):
        assert isinstance(event, Succeeded | Failed | Canceled) == (feedback.order_end is not None)


def test_an_agent_says_why_it_failed_by_a_number() -> None:
    progress = said("download", "DownloadingExtracting", count=40, of=100)
    failure = said(
        "closed", "ExecutingPreLaunch", "exit code 3", finished="failure", code=NUMBERS["PreLaunchFileFailure"]
    )

    events = told(progress, said("proceeding", "ExecutingPreLaunch"), failure)

    assert events[0] == Progressed(robot=ROBOT, action_id=8, step="DownloadingExtracting", percent_done=40.0)
    assert events[1] == Progressed(robot=ROBOT, action_id=8, step="ExecutingPreLaunch")
    assert events[2] == Failed(robot=ROBOT, action_id=8, code="PreLaunchFileFailure", reason="exit code 3")


@pytest.mark.parametrize("code", sorted(NUMBERS))
def test_each_number_is_a_code_that_a_robot_may_report(code: str) -> None:
    (event,) = told(said("closed", finished="failure", code=NUMBERS[code]))
    assert isinstance(event, Failed)
    assert event.code == code


def test_numbers_of_others_mean_nothing() -> None:
    (event,) = told(said("closed", "No suitable .swu image found", finished="failure", code=7))
    assert isinstance(event, Failed)
    assert (event.code, event.reason) == ("ExtractingBundleFailure", "No suitable .swu image found")
