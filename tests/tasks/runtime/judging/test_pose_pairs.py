"""Localization by topics: what the robot took for its pose, against the true one at the same time."""

import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.recorded_bags import EPOCH_S, TF, Said, header, link, odometry, turned, write_bag
from helpers.stop_flags import StopFlag
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import RunPlan, RunResult
from prefect_robomaker.schemas.runs.recording_sources import RecordingSources
from prefect_robomaker.schemas.runs.requirement_kinds.kind import PosePair
from prefect_robomaker.schemas.runs.requirement_kinds.localization import LocalizationRequirement, LocalizationRule
from prefect_robomaker.schemas.runs.requirements import parse_requirements
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.runtime.applications.recorded_run import RecordedRun, make_agent
from prefect_robomaker.tasks.runtime.episode.run_results import make_result
from prefect_robomaker.tasks.runtime.judging.bags import find_recording
from prefect_robomaker.tasks.runtime.judging.pose_pairs import PosePairs, StampedPose
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.requirements.observer import RequirementsObserver

Judge = Callable[..., RunResult]
AMCL = "geometry_msgs/msg/PoseWithCovarianceStamped"
KNOWS = {"kind": "localization", "name": "knows", "estimate": "/amcl_pose", "truth": "/truth", "max_m": 0.3}
BY_TF = KNOWS | {"estimate": "/tf"}


@pytest.fixture
def judge(tmp_path: Path) -> Judge:
    def run(path: Path, *requirements: dict[str, Any], **sources: Any) -> RunResult:
        plan = RunPlan.model_validate({
            "job_id": "sim-1", "job_arn": "arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1",
            "run_id": "run-1", "seed": 1, "max_duration_s": 60.0, "work_dir": tmp_path, "output_dir": tmp_path,
            "requirements": list(requirements),
        })  # fmt: skip
        observer = RequirementsObserver(plan)
        episode = run_episode(
            lambda: RecordedRun(find_recording(path), RecordingSources(**sources)),
            lambda environment: make_agent(None, environment),
            mark=lambda phase: None, stop=StopFlag(), recorder=Recorder(), watchers=[observer],
            wall_clock=itertools.count(0.0, 1.0).__next__,
        )  # fmt: skip
        return make_result(episode, 1, [observer.close(episode.ended_by)])

    return run


def place(time_s: float) -> tuple[float, float, float]:
    """The true pose: half a metre a second along x, turning a little."""
    return 0.5 * time_s, 0.0, 0.1 * time_s


def truths(seconds: float = 12.0) -> list[Said]:
    """The true pose, 20 times a second."""
    return [odometry(EPOCH_S + n / 20, place(n / 20), "/truth") for n in range(round(seconds * 20) + 1)]


def estimates(off_m: float = 0.05, *, late_s: float = 0.4, every_s: float = 0.5, until_s: float = 12.0) -> list[Said]:
    """Estimates of an AMCL, which come late, with the stamp of the scan that they are of."""
    found: list[Said] = []
    for n in range(round(until_s / every_s)):
        time_s = n * every_s
        x, y, yaw = place(time_s)
        where = {"pose": {"position": {"x": x, "y": y + off_m}, "orientation": turned(yaw)}}
        fields = {"header": header(EPOCH_S + time_s, "map"), "pose": where}
        found.append(Said(EPOCH_S + time_s + late_s, "/amcl_pose", AMCL, fields))
    return found


def frames(off_m: float = 0.05, until_s: float = 12.0) -> list[Said]:
    """Odometry that drifts, and a localization that corrects it until it dies, in the way of AMCL: a second ahead."""
    found: list[Said] = []
    for n in range(241):
        time_s, drift = n / 20, 0.02 * n / 20
        x, y, yaw = place(time_s)
        links = [link(EPOCH_S + time_s, "odom", "base_link", (x + drift, y, yaw))]
        found.append(Said(EPOCH_S + time_s, "/tf", TF, {"transforms": links}))
        if n % 4 == 0 and time_s < until_s:
            links = [link(EPOCH_S + time_s + 1.0, "map", "odom", (-drift, off_m, 0.0))]
            found.append(Said(EPOCH_S + time_s + 0.001, "/tf", TF, {"transforms": links}))
    return found


@pytest.mark.parametrize(("asked", "heard"), [(KNOWS, estimates), (BY_TF, frames)])
def test_an_estimate_is_compared_with_the_truth_at_its_time(
    judge: Judge, tmp_path: Path, asked: dict[str, Any], heard: Callable[[float], list[Said]]
) -> None:
    """Half a metre a second, 0.4 s late: by the times of receipt the error would be 0.2 m more."""
    bag = write_bag(tmp_path / "bag", "mcap", [*truths(), *heard(0.05)])
    (row,) = judge(bag, asked | {"max_deg": 3.0}).requirements
    assert row.error is None
    assert row.satisfied
    assert row.value == pytest.approx(0.05, abs=0.01)
    (off,) = judge(write_bag(tmp_path / "off", "mcap", [*truths(), *heard(0.4)]), asked).requirements
    assert not off.satisfied
    assert off.error is None
    assert off.value == pytest.approx(0.4, abs=0.01)


def test_frames_that_are_taken_for_the_map_are_told(judge: Judge, tmp_path: Path) -> None:
    result = judge(write_bag(tmp_path / "bag", "mcap", [*truths(), *estimates()]), KNOWS)
    assert result.notes == ["poses on /truth are in the frame 'odom', which is taken for 'map'"]


@pytest.mark.parametrize(
    ("asked", "messages", "says"),
    [
        (KNOWS, truths(), "has no topic /amcl_pose"),
        (KNOWS, estimates(), "has no topic /truth"),
        (KNOWS | {"truth": "/tf"}, [*truths(), *estimates(), *frames()], "a pose to compare is /tf, whose type is"),
        (BY_TF, truths(), "/tf does not lead from 'map' to 'base_link' (it has none)"),
        (KNOWS, [*truths(), *estimates(until_s=6.0)], "no message on /amcl_pose from 5.90 to"),
        (BY_TF, [*truths(), *frames(until_s=6.0)], "no message on /tf (map to odom) from"),
        (KNOWS, [*truths(6.0), *estimates()], "no message on /truth from 6.00 to"),
        (KNOWS | {"from_s": 11.95}, [*truths(), *estimates()], "no pose on /amcl_pose came from from_s, 11.95 s"),
        (KNOWS, [*truths(), *(m._replace(fields={**m.fields, "header": header(7.0, "map")}) for m in estimates())],
         "stamps on /amcl_pose and /truth are of two clocks, 1759999993.4 s apart"),
    ],
)  # fmt: skip
def test_what_could_have_been_missed_is_an_error(
    judge: Judge, tmp_path: Path, asked: dict[str, Any], messages: list[Said], says: str
) -> None:
    (row,) = judge(write_bag(tmp_path / "bag", "mcap", messages), asked).requirements
    assert says in str(row.error), row


def test_a_robot_that_stands_needs_no_new_estimate(judge: Judge, tmp_path: Path) -> None:
    """AMCL is silent where the robot does not move."""
    stays = [odometry(EPOCH_S + n / 20, place(6.0), "/truth") for n in range(121, 241)]
    bag = write_bag(tmp_path / "bag", "mcap", [*truths(6.0), *stays, *estimates(until_s=6.0)])
    assert judge(bag, KNOWS).verdict == "PASS"


@pytest.mark.parametrize(
    ("members", "says"),
    [
        ({}, "neither attribute and estimate"),
        ({"attribute": "a.b", "estimate": "/a", "truth": "/b"}, "both attribute and estimate"),
        ({"estimate": "/a"}, "estimate needs truth, the topic with the true pose"),
        ({"attribute": "a.b", "truth": "/a"}, "truth needs estimate"),
        ({"estimate": "/a", "truth": "/a"}, "are both /a, so the error is always 0"),
        ({"estimate": "/a", "truth": "/b", "stop": True}, "leave out stop"),
        ({"estimate": "/a", "truth": "/b", "body": "base"}, "leave out body"),
    ],
)
def test_what_does_not_go_together_is_refused(members: dict[str, Any], says: str) -> None:
    with pytest.raises(InvalidParameterException, match=says):
        parse_requirements([{"kind": "localization", "name": "knows", "max_m": 0.3, **members}], "requirements")


@given(
    offsets=st.lists(st.floats(-5.0, 5.0, allow_nan=False), min_size=1, max_size=12),
    period_s=st.floats(0.05, 0.9),
    latency_s=st.floats(0.0, 0.9),
)
def test_the_largest_error_is_found_whatever_the_rates(offsets: list[float], period_s: float, latency_s: float) -> None:
    """The truth moves on a line, so that what lies between two of its poses is known exactly."""
    asked = LocalizationRequirement(
        kind="localization", name="knows", estimate="/a", truth="/b", max_m=100.0, attribute=None
    )
    rule = LocalizationRule(asked)

    def true(period_s: float) -> Iterator[StampedPose]:
        for n in range(math.ceil((len(offsets) + 2) / period_s)):
            yield StampedPose(n * period_s, n * period_s, place(n * period_s))

    def taken() -> Iterator[StampedPose]:
        for n, offset in enumerate(offsets):
            x, y, yaw = place(float(n))
            yield StampedPose(n + latency_s, float(n), (x, y + offset, yaw))

    pairs = PosePairs(rule, asked, ("/a", "/b"), 1.0, is_steady=False)
    found = list(pairs.of(taken(), true(period_s)))
    for pair in found:
        rule.update(pair.time_s, pair.estimate, pair.truth)
    assert len(found) == len(offsets)
    assert rule.error is None
    assert rule.worst_m == pytest.approx(max(map(abs, offsets)), abs=1e-6)


@pytest.mark.parametrize(("first_s", "truth_s"), [(30.0, 0.0), (0.0, 30.0)])
def test_one_clock_at_half_the_speed_is_one_clock(first_s: float, truth_s: float) -> None:
    """Stamps are of a simulation that takes two seconds for one, so that they fall behind the times of receipt."""
    assert len(pairs_at_half_speed(first_s, truth_s, ahead_s=0.0)) == 60 - max(first_s, truth_s)


@pytest.mark.parametrize(("first_s", "truth_s"), [(30.0, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize("ahead_s", [-12.0, 12.0])
def test_two_clocks_are_found_wherever_the_first_estimate_is(first_s: float, truth_s: float, ahead_s: float) -> None:
    with pytest.raises(AssertionError, match=r"are of two clocks, 12\.0 s apart"):
        pairs_at_half_speed(first_s, truth_s, ahead_s)


def pairs_at_half_speed(first_s: float, truth_s: float, ahead_s: float) -> list[PosePair]:
    """The pairs of a robot that stands for a minute, with estimates and true poses from times of receipt on."""
    asked = LocalizationRequirement(
        kind="localization", name="knows", estimate="/a", truth="/b", max_m=1.0, attribute=None
    )
    rule = LocalizationRule(asked)
    taken = (StampedPose(float(n), n / 2 + ahead_s, place(0.0)) for n in range(round(first_s), 60))
    true = (StampedPose(n / 20, n / 40, place(0.0)) for n in range(round(20 * truth_s), 1200))
    found = list(PosePairs(rule, asked, ("/a", "/b"), 1.0, is_steady=False).of(taken, true))
    assert rule.error is None, rule.error
    return found
