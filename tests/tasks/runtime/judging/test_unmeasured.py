"""Recordings that do not hold what is asked for in less plain ways: blind lidars, frames that are nowhere."""

import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from helpers.recorded_bags import (
    EPOCH_S,
    MODELS,
    STATES,
    TF,
    Said,
    drive,
    link,
    touch,
    write_bag,
)
from helpers.stop_flags import StopFlag
from mcap.reader import make_reader
from mcap.writer import Writer

from prefect_robomaker.schemas.runs.plan import Requirement, RunPlan, RunResult
from prefect_robomaker.schemas.runs.recording_sources import RecordingSources
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.runtime.applications.recorded_run import RecordedRun, make_agent
from prefect_robomaker.tasks.runtime.episode.run_results import make_result
from prefect_robomaker.tasks.runtime.judging.bags import find_recording
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.requirements.observer import RequirementsObserver

Judge = Callable[..., RunResult]

GOAL = {"kind": "goal", "name": "there", "x": 4.0, "y": 0.0, "within_m": 0.3, "by_s": 10.5}
POLITE = {"kind": "clearance", "name": "polite", "min_m": 0.3}


def plan_of(folder: Path, requirements: Sequence[dict[str, Any]], **members: Any) -> RunPlan:
    return RunPlan.model_validate({
        "job_id": "sim-1", "job_arn": "arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1",
        "run_id": "run-1", "seed": 1, "max_duration_s": 60.0, "work_dir": folder, "output_dir": folder,
        "requirements": list(requirements), **members,
    })  # fmt: skip


@pytest.fixture
def judge(tmp_path: Path) -> Judge:
    def run(path: Path, *requirements: dict[str, Any], world: World | None = None, **sources: Any) -> RunResult:
        observer = RequirementsObserver(plan_of(tmp_path, requirements), world)
        episode = run_episode(
            lambda: RecordedRun(find_recording(path), RecordingSources(**sources)),
            lambda environment: make_agent(None, environment),
            mark=lambda phase: None, stop=StopFlag(), recorder=Recorder(), watchers=[observer],
            wall_clock=itertools.count(0.0, 1.0).__next__,
        )  # fmt: skip
        return make_result(episode, 1, [observer.close(episode.ended_by)])

    return run


def only(result: RunResult) -> Requirement:
    (requirement,) = result.requirements
    return requirement


@pytest.mark.parametrize("nothing", [math.inf, 10.0])
def test_a_lidar_that_never_sees_anything_is_no_clearance(judge: Judge, tmp_path: Path, nothing: float) -> None:
    """That of a simulation without a screen often is so."""
    bag = write_bag(tmp_path / "bag", "mcap", rays(lambda ranges: [nothing] * len(ranges)))
    assert "never saw anything" in str(only(judge(bag, POLITE, radius_m=0.2)).error)


def test_rays_that_never_tell_anything_are_a_blind_side(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", rays(lambda ranges: [math.nan] * 60 + list(ranges[60:])))
    assert "over 60 degrees never told anything" in str(only(judge(bag, POLITE, radius_m=0.2)).error)
    assert judge(bag, POLITE, radius_m=0.2, partial_scan=True).verdict == "PASS"


def rays(changed: Callable[[Sequence[float]], list[float]]) -> list[Said]:
    return [
        m._replace(fields={**m.fields, "ranges": changed(m.fields["ranges"])}) if m.topic == "/scan" else m
        for m in drive()
    ]


def test_a_clearance_of_a_part_of_the_robot_is_not_told_by_a_lidar(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", drive())
    assert "leave out body" in str(only(judge(bag, POLITE | {"body": "gripper"}, radius_m=0.2)).error)
    assert judge(bag, POLITE | {"body": "base_link"}, radius_m=0.2).verdict == "PASS"


def test_a_frame_with_two_parents_is_nowhere(judge: Judge, tmp_path: Path) -> None:
    """Two nodes that both say where the robot is: its place would be counted twice."""
    messages = [m for m in drive() if m.topic not in ("/odom", "/tf_static")]
    messages.append(
        Said(EPOCH_S, "/tf_static", TF, {"transforms": [link(EPOCH_S, "base_footprint", "base_link", (0.0, 0.0, 0.0))]})
    )
    for step in range(241):
        time_s = EPOCH_S + step / 20
        links = [link(time_s, "map", "base_footprint", (0.4 * step / 20, 0.0, 0.0))]
        messages.append(Said(time_s, "/tf", TF, {"transforms": links}))
        if step >= 20:
            links = [link(time_s, "odom", "base_link", (0.4 * step / 20, 0.0, 0.0))]
            messages.append(Said(time_s + 0.001, "/tf", TF, {"transforms": links}))
    far = only(judge(write_bag(tmp_path / "bag", "mcap", messages), GOAL | {"x": 8.0, "by_s": 12.0}))
    assert "'base_link' has two parents on /tf, 'base_footprint' and 'odom'" in str(far.error)


def test_frames_that_never_move_tell_no_speed(judge: Judge, tmp_path: Path) -> None:
    messages = [m for m in drive() if m.topic != "/odom"]
    messages.append(
        Said(EPOCH_S, "/tf_static", TF, {"transforms": [link(EPOCH_S, "map", "base_link", (0.0, 0.0, 0.0))]})
    )
    slow = only(judge(write_bag(tmp_path / "bag", "mcap", messages), {"kind": "speed", "name": "slow", "max_mps": 0.1}))
    assert "it could not move" in str(slow.error)


def test_a_goal_where_the_robot_starts_is_told_also_before_the_first_pose(judge: Judge, tmp_path: Path) -> None:
    late = [m for m in drive() if m.topic != "/odom" or m.time_s > EPOCH_S + 0.5]
    result = judge(write_bag(tmp_path / "bag", "mcap", late), {"kind": "goal", "name": "home", "x": 0.0, "y": 0.0})
    assert "home: reached where the robot starts, before it moved" in result.notes


def test_a_recording_without_an_index_is_read_by_several_at_once(judge: Judge, tmp_path: Path) -> None:
    """`ros2 bag record --storage-preset-profile fastwrite` makes such ones."""
    path = tmp_path / "fast.mcap"
    indexed = write_bag(tmp_path / "bag", "mcap", drive())
    with path.open("wb") as file, next(indexed.glob("*.mcap")).open("rb") as whole:
        writer, reader = Writer(file, use_chunking=False), make_reader(whole)
        writer.start("ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number, channel.metadata)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    topic = {"kind": "topic", "name": "seen", "topic": "/scan", "min_hz": 4.0}

    result = judge(path, GOAL, POLITE, topic, radius_m=0.2)

    assert [each.error for each in result.requirements] == [None] * 3
    assert result.verdict == "PASS"
    assert result.requirements[2].value == pytest.approx(61 / 12, abs=0.02)


# Names

GENTLE = {"kind": "no_collision", "name": "gentle", "max_force_N": 20}


def touches(*touched: str, force: float = 35.0) -> list[Said]:
    """A drive in which the robot touches things of these names, and its bumper always speaks."""
    quiet = [Said(EPOCH_S + step / 20, "/bumper", STATES, {"states": []}) for step in range(241)]
    return [*drive(), *quiet, *(touch(EPOCH_S + 4.0, name, "bot::link::c", force) for name in touched)]


def test_a_misspelt_name_of_what_counts_is_no_pass(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", touches("wall_3::link::c", "chair::link::c"))
    misspelt = only(judge(bag, GENTLE | {"others": ["wal_*"]}, robot="bot"))
    assert "nothing in the recording is named like 'wal_*' (others); did you mean 'wall_3'?" in str(misspelt.error)
    assert judge(bag, GENTLE | {"others": ["wall_*"]}, robot="bot").verdict == "FAIL"
    assert judge(bag, GENTLE | {"others": ["wall_*"], "max_force_N": 40}, robot="bot").verdict == "PASS"
    # Where nothing was touched, a list of the models tells a name from a misspelt one.
    quiet = write_bag(tmp_path / "quiet", "mcap", touches())
    assert "no names in it" in str(only(judge(quiet, GENTLE | {"others": ["wall_*"]}, robot="bot")).error)
    models = Said(EPOCH_S, "/gazebo/model_states", MODELS, {"name": ["ground_plane", "bot", "wall_3"]})
    listed = write_bag(tmp_path / "listed", "mcap", [*touches(), models])
    assert judge(listed, GENTLE | {"others": ["wall_3::link::*"]}, robot="bot").verdict == "PASS"
    for name in ("wal_3", "bot", "ground_plane"):
        assert judge(listed, GENTLE | {"others": [name]}, robot="bot").verdict == "ERROR", name


def test_a_misspelt_name_of_what_is_ignored_is_told(judge: Judge, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", "mcap", touches("wall_3::link::c"))
    failed = judge(bag, GENTLE | {"ignore": ["wal_3*"]}, robot="bot")
    assert failed.verdict == "FAIL"
    assert [note for note in failed.notes if "named like 'wal_3*' (ignore); did you mean 'wall_3'?" in note]
    assert judge(bag, GENTLE | {"ignore": ["wall_3*", "rug"]}, robot="bot").verdict == "PASS"
    everything = only(judge(bag, GENTLE | {"ignore": ["toy", "*"]}, robot="bot"))
    assert "ignore is '*', which is everything" in str(everything.error)
    models = Said(EPOCH_S, "/gazebo/model_states", MODELS, {"name": ["ground_plane", "bot", "wall_3"]})
    listed = write_bag(tmp_path / "listed", "mcap", [*touches(), models])
    assert "named like 'wal_3' (ignore)" in str(only(judge(listed, GENTLE | {"ignore": ["wal_3"]}, robot="bot")).error)
    assert judge(listed, GENTLE | {"ignore": ["rug"]}, robot="bot").verdict == "PASS"
    assert judge(listed, GENTLE | {"ignore": ["wall_*"]}, robot="bot").verdict == "ERROR", "nothing is left"


def test_frames_of_a_robot_in_a_namespace_are_no_list_of_models(judge: Judge, tmp_path: Path) -> None:
    """Names of things may be frames of Gazebo's `pose/info`; those of `/robot1/tf` are parts of a robot."""
    links = [link(EPOCH_S, "odom", "base_link", (0.0, 0.0, 0.0)), link(EPOCH_S, "odom", "wall_3", (0.0, 0.0, 0.0))]

    def verdict(topic: str) -> str | None:
        frames = Said(EPOCH_S, topic, TF, {"transforms": links})
        bag = write_bag(tmp_path / topic.replace("/", "_"), "mcap", [*touches(), frames])
        return judge(bag, GENTLE | {"others": ["wall_3"]}, robot="bot").verdict

    assert verdict("/world/flat/pose/info") == "PASS"
    for topic in ("/robot1/tf", "/robot1/tf_static"):
        assert verdict(topic) == "ERROR", topic


# Types


@pytest.mark.parametrize(
    ("topic", "asked", "sources"),
    [
        ("/odom", GOAL, {}),
        ("/scan", POLITE, {"radius_m": 0.2}),
        ("/bumper", GENTLE, {"robot": "bot"}),
    ],
)
def test_a_topic_of_two_types_is_one_error(
    judge: Judge, tmp_path: Path, topic: str, asked: dict[str, Any], sources: dict[str, Any]
) -> None:
    path = tmp_path / "mixed.mcap"
    indexed = write_bag(tmp_path / "bag", "mcap", touches())
    with path.open("wb") as file, next(indexed.glob("*.mcap")).open("rb") as whole:
        writer, reader = Writer(file), make_reader(whole)
        writer.start("ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number, channel.metadata)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        other = writer.register_schema("std_msgs/msg/Empty", "ros2msg", b"")
        number = writer.register_channel(topic, "cdr", other, {})
        writer.add_message(number, EPOCH_S * 10**9 + 10**9, b"\0\1\0\0\0", EPOCH_S * 10**9)
        writer.finish()
    quick = {"kind": "speed", "name": "slow", "max_mps": 2.0}

    row, other_row = judge(path, asked, quick, **sources).requirements

    assert f"mixed.mcap: {topic} has messages of " in str(row.error)
    assert "and std_msgs/msg/Empty" in str(row.error)
    assert "name it in the sources" in str(row.error)
    assert topic == "/odom" or other_row.satisfied, "the rest is judged"


# Ends


def test_a_time_limit_that_a_recording_does_not_reach_is_an_error(judge: Judge, tmp_path: Path) -> None:
    """It may be cut short: only goals, or its maker, say that the run was over."""
    quick = {"kind": "time_limit", "name": "quick", "limit_s": 30.0}
    bag = write_bag(tmp_path / "bag", "mcap", drive())
    cut = only(judge(bag, quick))
    assert "the recording ends at 12.00 s, before the limit of 30 s, and may be cut short" in str(cut.error)
    assert judge(bag, quick, ends_with_run=True).verdict == "PASS"
    assert judge(bag, quick, GOAL).verdict == "PASS"
    missed = judge(bag, quick, GOAL, GOAL | {"name": "far", "x": 9.0})
    assert [each.error is None for each in missed.requirements] == [False, True, True]
    assert judge(bag, quick | {"limit_s": 11.0}).verdict == "FAIL", "it was not over then"
    stopped = judge(bag, quick, {"kind": "speed", "name": "slow", "max_mps": 0.1, "stop": True})
    assert stopped.requirements[0].satisfied, "a requirement ended the run, and the recording went on"


# Formulas


@pytest.mark.parametrize(
    ("formula", "sources", "says"),
    [
        ("always (z > -1)", {}, "poses of /odom never change their height, as those of wheels"),
        ("always (clearance > 0.01)", {"radius_m": 0.05}, "/scan sees nothing nearer than 0.1 m"),
        ("always (0.5 * speed < clearance)", {"radius_m": 0.15}, "so (0.5 * speed) < clearance could not be told"),
        ("always (clearance > 0.2)", {"radius_m": 0.05}, None),
        ("always (clearance < 0.3 -> speed < 0.1)", {"radius_m": 0.2}, None),
    ],
)
def test_formulas_about_what_a_recording_cannot_tell_are_errors(
    judge: Judge, tmp_path: Path, formula: str, sources: dict[str, Any], says: str | None
) -> None:
    pytest.importorskip("rtamt")
    bag = write_bag(tmp_path / "bag", "mcap", drive())
    row = only(judge(bag, {"kind": "expression", "name": "safe", "formula": formula}, **sources))
    assert row.satisfied if says is None else says in str(row.error), row


def test_heights_that_change_are_told(judge: Judge, tmp_path: Path) -> None:
    pytest.importorskip("rtamt")
    where = {"pose": {"position": {"z": 0.2}, "orientation": {"w": 1.0}}}
    messages = [
        m._replace(fields={**m.fields, "pose": where}) if m.topic == "/odom" and m.time_s > EPOCH_S + 6 else m
        for m in drive()
    ]
    bag = write_bag(tmp_path / "bag", "mcap", messages)
    for limit, verdict in ((0.3, "PASS"), (0.1, "FAIL")):
        asked = {"kind": "expression", "name": "low", "formula": f"always (z < {limit})"}
        assert judge(bag, asked).verdict == verdict
