import itertools
import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import dm_env
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import (
    IndoorNavigation,
    make_environment,
)
from prefect_robomaker.tasks.runtime.applications.scout.agent import Scout, make_agent
from prefect_robomaker.tasks.runtime.episode.context import SimulationContext
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder


def run(context: SimulationContext, poses_of: int | None = None) -> tuple[IndoorNavigation, Scout, list[Any]]:
    """Returns environment, agent and every pose, or the first ones."""
    environment = make_environment(context)
    agent = make_agent(context, environment)
    timestep = environment.reset()
    poses = []
    while not timestep.last() and len(poses) != poses_of:
        try:
            timestep = environment.step(agent(timestep))
        except StopIteration:
            break
        poses.append(timestep.observation["pose"])
    return environment, agent, poses


def test_visits_every_room_without_touching_anything(make_context) -> None:
    environment, agent, _ = run(make_context(seed=3))
    report = environment.run_result()
    assert report.verdict == "PASS", report.summary
    assert report.collisions == []
    assert all(room.visited for room in report.rooms)
    assert agent.given_up == []
    assert agent.run_notes() == []
    assert report.metrics["sim_time_s"] < 40
    assert report.metrics["mean_speed_mps"] > 0.3
    assert len(report.path) <= 600
    assert report.path[0][1:] == pytest.approx((0.0, 0.0), abs=1e-3)


def test_the_same_seed_gives_the_same_run_to_the_last_bit_recorded_or_not(make_context, tmp_path) -> None:
    loose = [("Toy_1", 0.45, 1.3, 0.05)]
    first = np.array(run(make_context(seed=5, loose=loose), 300)[2])
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        second = np.array(run(make_context(seed=5, loose=loose, recorder=recorder), 300)[2])
    other = np.array(run(make_context(seed=6, loose=loose), 300)[2])
    assert first.tobytes() == second.tobytes()
    assert first.tobytes() != other.tobytes()


def test_publishes_where_it_goes(make_context, tmp_path: Path) -> None:
    context = make_context(seed=3)
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        run(replace(context, recorder=recorder))
    with AnyReader([tmp_path]) as reader:
        found: list[tuple[str, Any]] = [
            (connection.topic, reader.deserialize(raw, connection.msgtype))
            for connection, _, raw in reader.messages()
            if connection.topic in {"/goal_pose", "/plan"}
        ]
    goals = [(message.pose.position.x, message.pose.position.y) for topic, message in found if topic == "/goal_pose"]
    assert set(goals) == {room.goal for room in context.world.floorplan.rooms}
    plans = [[pose.pose.position for pose in message.poses] for topic, message in found if topic == "/plan"]
    assert len(plans) == len(goals)
    for goal, plan in zip(goals, plans, strict=True):
        assert (plan[-1].x, plan[-1].y) == pytest.approx(goal, abs=0.3)
        steps = [math.dist((a.x, a.y), (b.x, b.y)) for a, b in itertools.pairwise(plan)]
        assert max(steps) < 0.4


@pytest.mark.parametrize(
    "half_side_m",
    [pytest.param(0.04, id="below the lidar"), pytest.param(0.12, id="seen by the lidar", marks=pytest.mark.deep)],
)
def test_drives_around_things_that_the_map_does_not_show(make_context, half_side_m: float) -> None:
    # In the way from the hall into the living room, and in the middle of the hall.
    loose = [("Toy_1", 0.2, 1.5, half_side_m), ("Toy_2", 2.5, -0.1, half_side_m)]
    environment, _, _ = run(make_context(seed=2, loose=loose))
    report = environment.run_result()
    assert report.verdict == "PASS", report.summary
    assert report.metrics["max_collision_force_N"] < 20


def test_gives_up_a_room_behind_a_blocked_door_and_says_so(make_context, caplog) -> None:
    context = make_context(seed=1)
    path = context.world_dir / "world.xml"
    door = '<geom name="wall-door" type="box" pos="0.45 1 1" size="0.45 0.05 1"/>'
    other = '<geom name="wall-other" type="box" pos="3 2.95 1" size="0.05 0.45 1"/>'
    path.write_text(path.read_text().replace("<worldbody>", f"<worldbody>{door}{other}"))
    with caplog.at_level(logging.WARNING):
        environment, agent, _ = run(context)
    report = environment.run_result()
    assert agent.given_up == ["living"]
    assert "gave up on living" in caplog.text
    assert agent.run_notes() == ["scout gave up on living: no way there that the robot could drive"]
    assert {room.name: room.visited for room in report.rooms} == {"hall": True, "living": False, "kitchen": True}
    assert report.verdict == "FAIL"
    assert report.metrics["max_collision_force_N"] < 20
    assert report.metrics["sim_time_s"] < 120


def test_leaves_when_there_is_nothing_left_to_do(make_context) -> None:
    context = make_context()
    agent = make_agent(context, make_environment(context))
    observation = make_environment(context).reset().observation
    agent._queue = []
    for step in range(21):
        action = agent(dm_env.transition(0.0, observation | {"time": np.array(step * 0.05)}))
        assert action.tolist() == [0.0, 0.0]
        assert agent.done
    with pytest.raises(StopIteration):
        agent(dm_env.transition(0.0, observation | {"time": np.array(1.1)}))


def test_without_a_world_it_says_where_to_name_one(make_context) -> None:
    environment = make_environment(make_context())
    with pytest.raises(LaunchError, match="worldConfigs"):
        make_agent(make_context(with_world=False), environment)


def test_an_environment_of_another_kind_is_refused(make_context) -> None:
    class Other(IndoorNavigation):
        def observation_spec(self) -> dict[str, Any]:
            return {"time": None, "pose": None}

    environment = make_environment(make_context())
    environment.__class__ = Other
    with pytest.raises(LaunchError, match="does not give: proximity, scan, scan_time, velocity"):
        make_agent(make_context(), environment)


def test_a_missing_map_is_named(make_context) -> None:
    context = make_context()
    (context.world_dir / "map.yaml").unlink()
    with pytest.raises(LaunchError, match=r"cannot read the world's map.*map\.yaml"):
        make_agent(context, make_environment(context))
