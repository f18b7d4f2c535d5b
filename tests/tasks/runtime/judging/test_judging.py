"""Recordings judged by requirements: the same rules as in simulations, measured from topics."""

import importlib.util
import itertools
import json
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from helpers import hand_written_flat
from helpers.recorded_bags import (
    EPOCH_S,
    FORMATS,
    STATES,
    TF,
    Said,
    as_real_robot,
    clock,
    drive,
    link,
    odometry,
    touch,
    write_bag,
)
from helpers.stop_flags import StopFlag

from prefect_robomaker.schemas.runs.plan import Requirement, RunPlan, RunResult
from prefect_robomaker.schemas.runs.recording_sources import RecordingSources
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.runtime.applications import scout
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.applications.recorded_run import RecordedRun, make_agent
from prefect_robomaker.tasks.runtime.episode.run_results import OWN_VERDICT, make_result
from prefect_robomaker.tasks.runtime.judging.bags import RecordingFault, find_recording
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.cdr import encode
from prefect_robomaker.tasks.runtime.recording.mcap_file import McapFile, Unbuffered
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder, Recorder
from prefect_robomaker.tasks.runtime.requirements.observer import RequirementsObserver
from prefect_robomaker.tasks.runtime.supervision.recorded_verdicts import judge_topics

make_context = hand_written_flat.make_context
Judge = Callable[..., RunResult]

GOAL = {"kind": "goal", "name": "there", "x": 4.0, "y": 0.0, "within_m": 0.3, "by_s": 10.5}
POLITE = {"kind": "clearance", "name": "polite", "min_m": 0.3}
GENTLE = {"kind": "no_collision", "name": "gentle", "max_force_N": 20}
QUICK = {"kind": "time_limit", "name": "quick", "limit_s": 30}


def plan_of(folder: Path, requirements: Sequence[dict[str, Any]], **members: Any) -> RunPlan:
    return RunPlan.model_validate({
        "job_id": "sim-1", "job_arn": "arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1",
        "run_id": "run-1", "seed": 1, "max_duration_s": 60.0, "work_dir": folder, "output_dir": folder,
        "requirements": list(requirements), **members,
    })  # fmt: skip


@pytest.fixture
def judge(tmp_path: Path) -> Judge:
    def run(
        path: Path,
        *requirements: dict[str, Any],
        world: World | None = None,
        losses: dict[str, str] | None = None,
        **sources: Any,
    ) -> RunResult:
        observer = RequirementsObserver(plan_of(tmp_path, requirements), world)
        episode = run_episode(
            lambda: RecordedRun(find_recording(path), RecordingSources(**sources), losses),
            lambda environment: make_agent(None, environment),
            mark=lambda phase: None, stop=StopFlag(), recorder=Recorder(), watchers=[observer],
            wall_clock=itertools.count(0.0, 1.0).__next__,
        )  # fmt: skip
        return make_result(episode, 1, [observer.close(episode.ended_by)])

    return run


def only(result: RunResult) -> Requirement:
    (requirement,) = result.requirements
    return requirement


@pytest.mark.parametrize("kind", FORMATS)
def test_each_format_gives_the_same_rows(judge: Judge, tmp_path: Path, kind: str) -> None:
    bag = write_bag(tmp_path / "bag", kind, drive())

    result = judge(bag, GOAL, POLITE, QUICK, radius_m=0.2)

    goal, polite, quick = result.requirements
    assert result.verdict == "PASS", result
    assert goal.value == pytest.approx(9.25, abs=0.06)  # 3.7 m at 0.4 m/s
    assert polite.value == pytest.approx(6.0 - 0.4 * 12 - 0.2, abs=1e-3)
    assert quick.value == pytest.approx(12.0, abs=1e-6)
    assert result.notes == ["positions are those of /odom in the frame 'odom', which may drift from the map"]
    assert result.path[-1][1] == pytest.approx(4.8, abs=0.05)
    assert judge(bag, GOAL | {"by_s": 9.0}).verdict == "FAIL"
    near = only(judge(bag, POLITE | {"min_m": 1.5}, radius_m=0.2))
    assert not near.satisfied
    # 1.5 m are left of the 6 at x = 4.3, which the next scan sees
    assert near.first_violation_s == pytest.approx(10.75, abs=0.21)


@pytest.mark.deep
@pytest.mark.parametrize("kind", FORMATS)
def test_a_bag_as_a_real_robot_records_it_gets_the_verdicts_of_the_run(
    judge: Judge, make_context: Any, tmp_path: Path, kind: str
) -> None:
    rooms = [
        {"kind": "goal", "name": "living", "room": "living", "by_s": 60.0},
        {"kind": "goal", "name": "kitchen", "room": "kitchen", "after": "living"},
        {"kind": "goal", "name": "hurried", "room": "kitchen", "by_s": 3.0},
        {"kind": "clearance", "name": "polite", "min_m": 0.02},
        {"kind": "clearance", "name": "shy", "min_m": 0.4},
        {"kind": "time_limit", "name": "quick", "limit_s": 200.0},
    ]
    folder = tmp_path / "run"
    folder.mkdir()
    with McapRecorder(folder / "recording.mcap") as recorder:
        context = make_context(recorder=recorder)
        observer = RequirementsObserver(plan_of(tmp_path, rooms), context.world)
        episode = run_episode(
            lambda: make_environment(context), lambda environment: scout.make_agent(context, environment),
            mark=lambda phase: None, stop=StopFlag(), recorder=recorder, watchers=[observer],
        )  # fmt: skip
    ran = {each.name: each for each in make_result(episode, 1, [observer.close(episode.ended_by)]).requirements}
    bag = write_bag(tmp_path / "bag", kind, as_real_robot(folder))

    judged = judge(bag, *rooms, world=context.world, radius_m=scout_radius_m())

    assert {each.name: each.satisfied for each in judged.requirements} == {name: ran[name].satisfied for name in
        ("living", "kitchen", "hurried", "polite", "shy", "quick")}  # fmt: skip
    assert judged.verdict == "FAIL"
    assert {name for name, each in ran.items() if not each.satisfied} >= {"hurried", "shy"}
    assert not [each for each in judged.requirements if each.error is not None]
    assert judged.notes == [], "positions are in the map"
    values = {each.name: each.value for each in judged.requirements}
    for name, tolerance in (("living", 0.2), ("kitchen", 0.2), ("polite", 0.04), ("quick", 0.1)):
        assert values[name] == pytest.approx(ran[name].value, abs=tolerance), name
    kept = [each for each in rooms if each["name"] in ("living", "kitchen", "polite", "quick")]
    assert judge(bag, *kept, world=context.world, radius_m=scout_radius_m()).verdict == "PASS"
    # Its own recording says the same, and that nothing was touched.
    own = judge(folder, *kept, GENTLE, world=context.world, radius_m=scout_radius_m())
    assert own.verdict == "PASS", own.summary


def scout_radius_m() -> float:
    from prefect_robomaker.tasks.runtime.robots.scout import RADIUS_M

    return RADIUS_M


# What could have been missed


@pytest.mark.parametrize(
    ("asked", "sources", "without", "says"),
    [
        (GOAL, {}, "/odom", "does not say where the robot is: it has neither /tf nor /odom"),
        (GENTLE, {}, "", "no topic with contacts (gazebo_msgs/ContactsState"),
        (POLITE, {"radius_m": 0.2}, "/scan", "no topic /scan (sensor_msgs/msg/LaserScan); record one"),
        (POLITE, {}, "", "clearance by /scan needs the robot's radius (radius_m"),
        (POLITE, {"radius_m": 0.2}, "/tf_static", "/tf and /tf_static do not say where it is on base_link"),
        (POLITE | {"ignore": ["Toy*"]}, {"radius_m": 0.2}, "", "/scan has no names of things, so ignore"),
        (POLITE | {"min_m": 0.01}, {"radius_m": 0.05}, "", "sees nothing nearer than 0.1 m"),
        (GOAL | {"body": "gripper"}, {}, "", "no frame 'gripper' on /tf"),
    ],
)
def test_what_a_recording_does_not_hold_is_an_error_of_that_requirement_alone(
    judge: Judge, tmp_path: Path, asked: dict[str, Any], sources: dict[str, Any], without: str, says: str
) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", [each for each in drive() if each.topic != without])

    result = judge(bag, asked, QUICK, ends_with_run=True, **sources)

    row, quick = result.requirements
    assert result.verdict == "ERROR"
    assert row.error is not None
    assert says in row.error
    assert quick.satisfied, "the rest is judged"
    assert not {"min_clearance_m", "max_contact_force_N", "goals"} & result.metrics.keys(), "nothing was measured"


def silent(messages: list[Said], topic: str, from_s: float, to_s: float) -> list[Said]:
    return [m for m in messages if m.topic != topic or not from_s < m.time_s - EPOCH_S < to_s]


@pytest.mark.parametrize(("from_s", "to_s"), [(-1.0, 3.0), (5.0, 8.0), (9.0, 13.0)])
def test_silence_is_no_clearance(judge: Judge, tmp_path: Path, from_s: float, to_s: float) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", silent(drive(), "/scan", from_s, to_s))
    row = only(judge(bag, POLITE, radius_m=0.2))
    assert row.error is not None
    assert "no message on /scan from" in row.error
    assert "max_gap_s" in row.error
    assert judge(bag, POLITE, radius_m=0.2, max_gap_s=4.0).verdict == "PASS"


def test_what_was_found_before_a_silence_stands(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", silent(drive(), "/odom", 9.6, 11.9))
    assert judge(bag, GOAL).verdict == "PASS", "reached before"
    assert judge(bag, GOAL | {"by_s": 5.0}).verdict == "FAIL", "too late before"
    late = only(judge(bag, GOAL | {"x": 4.7, "by_s": 11.0}))
    assert late.error is not None, "it may have been there while nothing was heard"


def test_a_scan_that_does_not_see_all_around_is_an_error_unless_that_is_accepted(judge: Judge, tmp_path: Path) -> None:
    messages = [m._replace(fields={**m.fields, "angle_increment": math.radians(0.7)}) if m.topic == "/scan" else m
                for m in drive()]  # fmt: skip
    bag = write_bag(tmp_path / "bag", "mcap", messages)
    row = only(judge(bag, POLITE, radius_m=0.2))
    assert row.error is not None
    assert "sees 252 degrees" in row.error
    assert judge(bag, POLITE, radius_m=0.2, partial_scan=True).verdict == "PASS"


@pytest.mark.parametrize("value", [math.nan, 0.0])
def test_scans_of_broken_rays_are_none(judge: Judge, tmp_path: Path, value: float) -> None:
    messages = [m._replace(fields={**m.fields, "ranges": [value] * 360}) if m.topic == "/scan" else m for m in drive()]
    row = only(judge(write_bag(tmp_path / "bag", "mcap", messages), POLITE, radius_m=0.2))
    assert row.error is not None


def test_rays_that_end_too_near_are_a_violation(judge: Judge, tmp_path: Path) -> None:
    messages = [m._replace(fields={**m.fields, "ranges": [-math.inf, *[5.0] * 359]}) if m.topic == "/scan" else m
                for m in drive()]  # fmt: skip
    assert judge(write_bag(tmp_path / "bag", "mcap", messages), POLITE, radius_m=0.2).verdict == "FAIL"


# Contacts


def collisions(*touches: Said) -> list[Said]:
    """Gazebo classic also says, twenty times a second, that nothing is touched."""
    return [*drive(), *touches, *(bumper(EPOCH_S + step / 20) for step in range(241))]


def bumper(time_s: float) -> Said:
    return Said(time_s, "/bumper", STATES, {"states": []})


@pytest.mark.parametrize(
    "kind", [pytest.param(each, marks=() if each == "ros1" else pytest.mark.deep) for each in FORMATS]
)
def test_contacts_of_gazebo_count_by_name(judge: Judge, tmp_path: Path, kind: str) -> None:
    wall, floor = "wall_3::link::collision", "ground_plane::link::collision"
    robot = "turtlebot3::base_link::bumper"
    touches = [touch(EPOCH_S + s, robot, floor, 200.0) for s in range(1, 12)]
    touches += [touch(EPOCH_S + 4.0, wall, robot, 35.0), touch(EPOCH_S + 4.02, wall, robot, 30.0)]
    bag = write_bag(tmp_path / "bag", kind, collisions(*touches))

    hard = only(judge(bag, GENTLE, robot="turtlebot3"))

    assert not hard.satisfied
    assert hard.error is None
    assert hard.value == pytest.approx(35.0)
    assert hard.first_violation_s == pytest.approx(4.0, abs=0.011)
    assert f"({wall})" in hard.detail
    assert judge(bag, GENTLE | {"max_force_N": 36}, robot="turtlebot3").verdict == "PASS"
    assert judge(bag, GENTLE | {"ignore": ["wall_*"]}, robot="turtlebot3").verdict == "PASS"
    assert "say which is the robot's" in str(only(judge(bag, GENTLE)).error)
    wrong = only(judge(bag, GENTLE, robot="turtlebot4"))
    assert "no contact on /bumper is of a model named 'turtlebot4'" in str(wrong.error)
    assert "turtlebot3" in str(wrong.error)


def test_a_robot_that_is_everything_touches_nothing(judge: Judge, tmp_path: Path) -> None:
    touched = touch(EPOCH_S + 4.0, "chair::link::c", "bot::link::c", 25.0)
    bag = write_bag(tmp_path / "bag", "mcap", collisions(touched))
    assert "robot is '*', which the floor is called as well" in str(only(judge(bag, GENTLE, robot="*")).error)
    assert judge(bag, GENTLE, robot="b*").verdict == "FAIL"


def test_a_touch_in_the_first_moment_counts(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", collisions(touch(EPOCH_S, "chair::link::c", "bot::link::c", 25.0)))
    assert judge(bag, GENTLE, robot="bot").verdict == "FAIL"


def test_a_contact_without_a_force_is_an_error(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "sqlite", collisions(touch(EPOCH_S + 4.0, "bot::link::c", "wall::link::c", None)))
    assert "not how hard" in str(only(judge(bag, GENTLE, robot="bot")).error)


GZ_CONTACTS = "ros_gz_interfaces/msg/Contacts"


@pytest.mark.parametrize("kind", [STATES, GZ_CONTACTS])
def test_a_contact_topic_on_which_nothing_came_is_an_error_unless_it_speaks_on_touch_only(
    judge: Judge, tmp_path: Path, kind: str
) -> None:
    bag = write_bag(tmp_path / "bag", "sqlite", drive(), silent={"/bumper": kind})
    silent = judge(bag, GENTLE, robot="bot")
    assert silent.verdict == "ERROR"
    assert "no message came on /bumper: nothing was touched, or its sensor was off" in str(only(silent).error)
    assert "contacts_on_touch: true" in str(only(silent).error)

    meant = judge(bag, GENTLE, robot="bot", contacts_on_touch=True)

    assert meant.verdict == "PASS"
    assert meant.notes == ["no message came on /bumper, which is taken for nothing was touched"]


def test_a_bumper_that_dies_on_the_way_could_have_missed_something(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", silent(collisions(), "/bumper", 6.0, 13.0))
    assert "no message on /bumper from 6.00 to" in str(only(judge(bag, GENTLE, robot="bot")).error)
    assert judge(bag, GENTLE, robot="bot", contacts_on_touch=True).verdict == "PASS"
    whole = write_bag(tmp_path / "whole", "mcap", collisions())
    assert judge(whole, GENTLE, robot="bot").verdict == "PASS"


MARKERS = "visualization_msgs/msg/MarkerArray"


@pytest.mark.parametrize("text", ["", "e", "hit!", "-"])
def test_a_marker_that_does_not_say_how_hard_is_an_error(judge: Judge, tmp_path: Path, text: str) -> None:
    said = Said(EPOCH_S + 4.0, "/contacts", MARKERS, {"markers": [{"ns": "wall", "text": text}]})
    assert "wall was touched, and not how hard" in str(
        only(judge(write_bag(tmp_path / "bag", "mcap", [*drive(), said]), GENTLE)).error
    )


def test_of_contacts_that_are_not_recorded_whole_some_could_have_been_missed(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", collisions(touch(EPOCH_S + 4.0, "chair::link::c", "bot::link::c", 25.0)))
    losses = {"/bumper": "7 messages were left out"}
    soft = only(judge(bag, GENTLE | {"max_force_N": 36}, robot="bot", losses=losses))
    assert soft.error == "/bumper: 7 messages were left out, so something could have been missed"
    assert judge(bag, GENTLE, robot="bot", losses=losses).verdict == "FAIL"


# Time and frames


def gazebo(start_s: float = 0.0, seconds: float = 12.0) -> list[Said]:
    """The same run in a simulation at half of real time, which has a clock."""
    found = [m._replace(time_s=EPOCH_S + 2 * m.time_s) for m in drive(seconds, start_s)]
    return found + [
        clock(start_s + n / 50, EPOCH_S + 2 * (start_s + n / 50) - 1e-4) for n in range(round(seconds * 50) + 1)
    ]


def test_the_clock_is_the_time_of_a_simulation(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", gazebo())
    goal, quick = judge(bag, GOAL, QUICK).requirements
    assert goal.value == pytest.approx(9.25, abs=0.06)
    assert quick.value == pytest.approx(12.0, abs=0.03)
    assert only(judge(bag, QUICK, time="received", ends_with_run=True)).value == pytest.approx(24.0, abs=0.1)


def test_what_was_before_the_recording_could_have_been_missed(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", gazebo(start_s=50.0))
    late = only(judge(bag, GOAL | {"by_s": 61.0}))
    assert "no message on /odom from 0.00 to 50.00 s" in str(late.error)
    assert judge(bag, GOAL, start_s=50.0).verdict == "PASS"


def test_poses_come_by_frames_that_move(judge: Judge, tmp_path: Path) -> None:
    """The map's frame goes before the odometry, which is a metre away; a frame on the robot is a body."""
    messages = [m for m in drive() if m.topic != "/odom"]
    for step in range(241):
        time_s = EPOCH_S + step / 20
        links = [link(time_s, "odom", "base_link", (0.4 * step / 20 - 1.0, 0.0, 0.0)),
                 link(time_s, "base_link", "gripper", (0.3, 0.0, 0.0))]  # fmt: skip
        messages += [odometry(time_s, (9.0, 9.0, 0.0)), Said(time_s, "/tf", TF, {"transforms": links})]
        messages.append(Said(time_s, "/tf", TF, {"transforms": [link(time_s, "/map", "/odom", (1.0, 0.0, 0.0))]}))
    bag = write_bag(tmp_path / "bag", "ros1", messages)

    base, gripper, polite = judge(
        bag, GOAL, GOAL | {"name": "hand", "body": "gripper"}, POLITE, radius_m=0.2
    ).requirements

    assert base.value == pytest.approx(9.25, abs=0.06)
    assert gripper.value == pytest.approx(8.5, abs=0.11)
    assert polite.satisfied
    named = judge(bag, GOAL, pose="/odom")
    assert named.verdict == "FAIL"
    lost = [m for m in messages if m.topic != "/tf" or m.time_s < EPOCH_S + 6 or "map" not in str(m.fields)]
    row = only(judge(write_bag(tmp_path / "lost", "mcap", lost), GOAL))
    assert "no message on /tf (map to odom) from" in str(row.error), "the localisation died"


# Kinds that ask the scene for nothing else


def test_other_kinds_measure_by_the_same_topics(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "sqlite", drive())
    speed = {"kind": "speed", "name": "slow", "max_mps": 0.6}
    assert only(judge(bag, speed)).value == pytest.approx(0.4, abs=0.25)
    assert judge(bag, speed | {"max_mps": 0.3}).verdict == "FAIL"
    # Nothing is measured before there is a pose, which begins a little after the recording.
    late = [m for m in drive() if m.topic != "/odom" or m.time_s > EPOCH_S + 0.5]
    value = only(judge(write_bag(tmp_path / "late", "sqlite", late), speed)).value
    assert value is not None
    assert value < 0.65


def test_planar_poses_cannot_tell_tilt(judge: Judge, tmp_path: Path) -> None:
    upright = {"kind": "upright", "name": "upright", "max_tilt_deg": 10.0}
    flat = only(judge(write_bag(tmp_path / "flat", "mcap", drive()), upright))
    assert "never tilted in the least" in str(flat.error)

    def leaning(degrees: float) -> list[Said]:
        half = math.radians(degrees) / 2
        turn = {"x": math.sin(half), "w": math.cos(half)}
        where = {"pose": {"position": {}, "orientation": turn}}
        return [m._replace(fields={**m.fields, "pose": where}) if m.topic == "/odom" else m for m in drive()]

    if importlib.util.find_spec("rtamt") is not None:
        formula = {"kind": "expression", "name": "upright", "formula": "always (tilt < 10)"}
        assert "never tilted in the least" in str(only(judge(tmp_path / "flat", formula)).error)
    steady = only(judge(write_bag(tmp_path / "steady", "mcap", leaning(4.0)), upright))
    assert steady.value == pytest.approx(4.0, abs=1e-6)
    assert steady.satisfied
    assert judge(write_bag(tmp_path / "over", "mcap", leaning(40.0)), upright).verdict == "FAIL"


def test_distance_holds_between_two_scans(judge: Judge, tmp_path: Path) -> None:
    """A formula asks more often than the lidar measures: what is near stays near."""
    pytest.importorskip("rtamt")
    formula = {"kind": "expression", "name": "roomy", "formula": "eventually (clearance > 7)", "period_s": 0.05}
    bag = write_bag(tmp_path / "bag", "mcap", drive())
    row = only(judge(bag, formula, radius_m=0.2))
    assert row.error is None, row
    assert not row.satisfied, "nothing is ever farther than 5.7 m"


# What cannot be read


def cut(path: Path, share: float) -> Path:
    (file,) = [path] if path.is_file() else [each for each in path.iterdir() if each.suffix in (".mcap", ".db3")]
    os.truncate(file, round(file.stat().st_size * share))
    return path


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("share", [0.0, 0.5, 0.98])
def test_recordings_that_are_cut_off_are_refused_with_what_would_do(
    judge: Judge, tmp_path: Path, kind: str, share: float
) -> None:
    bag = cut(write_bag(tmp_path / "bag", kind, drive()), share)
    with pytest.raises(RecordingFault) as caught:
        judge(bag, GOAL, POLITE, radius_m=0.2)
    text = str(caught.value)
    assert "bag" in text
    assert any(tool in text for tool in ("mcap recover", "ros2 bag reindex", "rosbag reindex", "record a run"))
    assert "\n" not in text


def test_a_bag_with_fewer_messages_than_it_says_is_refused(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "sqlite", drive())
    text = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(text.replace("message_count: 241", "message_count: 300"))
    with pytest.raises(RecordingFault, match=r"is cut off: it says that .* have .* messages, and has"):
        judge(bag, GOAL)


def test_a_recording_without_messages_is_refused(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "sqlite", [], silent={"/odom": "nav_msgs/msg/Odometry"})
    with pytest.raises(RecordingFault, match="is empty: there is no message in it on its topics /odom"):
        judge(bag, GOAL)


@pytest.mark.parametrize(
    ("sources", "says"),
    [
        ({"pose": "/odon"}, "has no topic /odon; did you mean '/odom'"),
        ({"pose": "/scan"}, "pose is /scan, whose type is sensor_msgs/msg/LaserScan; nav_msgs/msg/Odometry"),
        ({"scan": "/odom"}, "scan is /odom, whose type is nav_msgs/msg/Odometry; sensor_msgs/msg/LaserScan"),
        ({"contacts": ["/bumper"]}, "has no topic /bumper"),
        ({"time": "clock"}, "there is no message on /clock; received would do"),
        ({"start_s": 13.0}, r"ends before start_s \(13 s\)"),
    ],
)
def test_topics_that_are_named_have_to_be_there(
    judge: Judge, tmp_path: Path, sources: dict[str, Any], says: str
) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", drive())
    with pytest.raises(RecordingFault, match=says):
        judge(bag, GOAL, **sources)


def test_a_message_that_is_not_of_its_type_is_refused(judge: Judge, tmp_path: Path) -> None:
    stream = Unbuffered(tmp_path / "bad.mcap")
    file = McapFile(stream, "ros2", "test", chunk_bytes=1)
    kind = "nav_msgs/msg/Odometry"
    from prefect_robomaker.tasks.runtime.recording.cdr import definition
    from prefect_robomaker.tasks.runtime.recording.messages import Clock, Time

    channel = file.add_channel("/odom", kind, definition(kind), {})
    file.add_message(channel, 5, encode(Clock(Time(1, 2))))
    file.finish()
    stream.close()
    with pytest.raises(RecordingFault, match=r"bad.mcap: message 1 on /odom is no nav_msgs/msg/Odometry"):
        judge(tmp_path / "bad.mcap", GOAL)


def test_time_that_goes_backwards_is_refused(judge: Judge, tmp_path: Path) -> None:
    reset = gazebo() + [m._replace(time_s=m.time_s + 100) for m in gazebo()]
    with pytest.raises(RecordingFault, match=r"time goes backwards on /clock, from 12.000 to 0.000 s; record each run"):
        judge(write_bag(tmp_path / "clock", "mcap", reset), GOAL)
    joined = drive() + [m._replace(time_s=m.time_s + 12.1) for m in drive() if m.topic == "/odom"]
    with pytest.raises(RecordingFault, match=r"time goes backwards on /odom, from 1760000012.000 to 1760000000.000 s"):
        judge(write_bag(tmp_path / "stamps", "ros1", joined), GOAL)


def test_places_that_hold_no_recording_are_told(tmp_path: Path) -> None:
    with pytest.raises(RecordingFault, match="does not exist"):
        find_recording(tmp_path / "nothing")
    with pytest.raises(RecordingFault, match="holds no recording"):
        find_recording(tmp_path)
    for name in ("a.mcap", "b.bag"):
        (tmp_path / name).touch()
    with pytest.raises(RecordingFault, match=r"holds 2 recordings: a.mcap, b.bag"):
        find_recording(tmp_path)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(RecordingFault, match="is no recording by its name"):
        find_recording(tmp_path / "notes.txt")


# Jobs of programs


@pytest.mark.deep
def test_a_job_of_programs_is_judged_by_its_recording(tmp_path: Path) -> None:
    """A Gazebo of the user's own: what it recorded decides, and what it said itself counts as well."""
    folder = tmp_path / "output"
    folder.mkdir()
    (tmp_path / "bag").mkdir()
    made = write_bag(tmp_path / "bag" / "run", "mcap", gazebo())
    (file,) = made.glob("*.mcap")
    file.rename(folder / "recording.mcap")
    unjudged = [{"name": each["name"], "kind": each["kind"], "satisfied": False, "detail": "", "error": "not yet"}
                for each in (GOAL, POLITE)]  # fmt: skip
    result = {
        "verdict": "ERROR", "requirements": unjudged, "sim_time_s": 0.0, "wall_time_s": 9.0, "real_time_factor": 0.0,
        "ended_by": "application", "seed": 1, "extra": {OWN_VERDICT: "NONE"},
    }  # fmt: skip

    def judged(*requirements: dict[str, Any], sources: dict[str, Any]) -> RunResult:
        (folder / "result.json").write_text(json.dumps(result))
        gazebo_application = {"role": "simulation", "name": "gazebo",
                              "environment_variables": {"ROBOMAKER_SOURCES": json.dumps(sources)}}  # fmt: skip
        plan = plan_of(tmp_path, requirements, output_dir=folder, simulation_application=gazebo_application)
        judge_topics(plan, {}, timed_out=False, stop=lambda: None, environment={**os.environ})
        return RunResult.model_validate_json((folder / "result.json").read_bytes())

    passed = judged(GOAL, POLITE, sources={"radius_m": 0.2})
    assert passed.verdict == "PASS", passed
    assert [each.satisfied for each in passed.requirements] == [True, True]
    assert passed.sim_time_s == pytest.approx(12.0, abs=0.03)
    assert OWN_VERDICT not in passed.extra
    without = judged(GOAL, POLITE, sources={})
    assert (without.verdict, without.requirements[0].satisfied) == ("ERROR", True)
    asks = {"kind": "predicate", "name": "mine", "attribute": "my_nav.rules.keeps_left"}
    assert "is a function, which is not called for a job of programs" in str(
        judged(asks, sources={}).requirements[-1].error
    )
    result["extra"] = {OWN_VERDICT: "FAIL"}
    assert judged(GOAL, POLITE, sources={"radius_m": 0.2}).verdict == "FAIL", "its own word counts as well"
    (folder / "recording.mcap").unlink()
    lacks = "could not be judged: the job has only programs, and they recorded no topics; {}"
    without = judged(GOAL, sources={}).requirements[-1].detail
    assert without == lacks.format("set loggingConfig.recordAllRosTopics")
    (folder / "logs").mkdir()
    (folder / "logs" / "ros-topics.log").write_text("no ROS topics are recorded: cyclonedds is not installed")
    assert judged(GOAL, sources={}).requirements[-1].detail == lacks.format("the notes say why")
    (folder / "recording.mcap").symlink_to(tmp_path / "elsewhere.mcap")
    assert "they recorded no topics" in str(judged(GOAL, POLITE, sources={"radius_m": 0.2}).requirements[-1].error)
