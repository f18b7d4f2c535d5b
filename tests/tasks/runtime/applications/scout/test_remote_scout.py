"""Scout in a process of its own, over the socket, does what it does in the job's process, to the last bit."""

import re
import shutil
import sys
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY
from mcap.reader import make_reader

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.tasks.runtime.agents import agent_client
from prefect_robomaker.tasks.runtime.process.child import BUILT_IN_ENVIRONMENT
from prefect_robomaker.tasks.runtime.replay.replay import read_outputs, rerun_plan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

PROGRAM = """
import pathlib, types
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.runtime.agents.agent_client import connect
from prefect_robomaker.tasks.runtime.applications.scout import make_agent
from prefect_robomaker.tasks.runtime.recording.recording import Recorder


with connect() as simulation:
    world_dir = pathlib.Path(simulation.hello["world_dir"])
    world = World.model_validate_json((world_dir / "world.json").read_bytes())
    # What a robot thinks is recorded in the simulation's process only.
    context = types.SimpleNamespace(world=world, world_dir=world_dir, recorder=Recorder())
    simulation.run(make_agent(context, simulation))
"""

WANDERING = """
import os
from prefect_robomaker.tasks.runtime.agents.agent_client import connect

with connect(mode="free", real_time_factor=20) as simulation:
    for step in simulation:
        if step.time_s > 8.0:
            break
        simulation.act([os.urandom(1)[0] / 400, os.urandom(1)[0] / 64 - 2])
"""

PAGE = REPOSITORY / "docs" / "robot-programs.md"


def recorded(plan: RunPlan) -> list[tuple[str, int, bytes]]:
    with (plan.output_dir / "recording.mcap").open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
        ]


@pytest.mark.deep
@pytest.mark.slow
def test_the_same_seed_gives_the_same_run_in_one_process_and_in_two(
    launcher: Launcher, make_context, tmp_path: Path
) -> None:
    given = make_context(seed=5, loose=[("Toy_1", 0.45, 1.3, 0.05)]).plan
    given = given.model_copy(update={"simulation_application": BUILT_IN_ENVIRONMENT})
    robot = ApplicationPlan(role="robot", name="scout-alone")
    argv = [sys.executable, "-c", PROGRAM]
    program = ProgramPlan(name="robot", role="robot", kind="application", argv=argv, folder=tmp_path)
    plans = [
        given.model_copy(
            update={"work_dir": tmp_path / name / "work", "output_dir": tmp_path / name / "out", **members}
        )
        for name, members in {"one": {}, "two": {"robot_application": robot, "programs": [program]}}.items()
    ]
    results = []
    for plan in plans:
        outcome = launcher.run(plan, lambda: None)
        assert outcome.status == "Completed", outcome.failure_reason
        results.append(RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes()))

    one, two = results
    assert two.verdict == "PASS"
    assert two.state_digest is not None
    assert two.state_digest == one.state_digest, "positions, velocities and commands at every look, as a hash"
    assert two.path == one.path
    steps = two.extra["agent"]["actions"]
    assert two.metrics == one.metrics
    assert steps > 300
    first, second = map(recorded, plans)
    topics = {topic for topic, _, _ in second}
    assert topics >= {"/clock", "/odom", "/scan", "/joint_states", "/tf"}
    assert len(second) > 1000
    assert sorted(message for message in first if message[0] in topics) == sorted(second)


@pytest.mark.deep
def test_what_a_robot_did_by_chance_and_in_its_own_time_is_repeated_to_the_bit(
    launcher: Launcher, make_context, tmp_path: Path
) -> None:
    argv = [sys.executable, "-c", WANDERING]
    given = make_context(seed=5, loose=[("Toy_1", 0.45, 1.3, 0.05)]).plan
    plan = given.model_copy(
        update={
            "work_dir": tmp_path / "work",
            "output_dir": tmp_path / "out",
            "simulation_application": BUILT_IN_ENVIRONMENT,
            "robot_application": ApplicationPlan(role="robot", name="wanderer"),
            "programs": [ProgramPlan(name="robot", role="robot", kind="application", argv=argv, folder=tmp_path)],
        }
    )
    assert launcher.run(plan, lambda: None).status == "Completed"
    first = read_outputs(plan.output_dir)

    again = rerun_plan(plan, first, tmp_path / "again")
    outcome = launcher.run(again, lambda: None)

    assert outcome.status == "Completed", outcome.failure_reason
    second = read_outputs(again.output_dir)
    assert again.programs == []
    assert first.result is not None
    assert second.result is not None
    assert first.result.state_digest == second.result.state_digest is not None
    for name in ("ended_by", "verdict", "metrics", "path", "collisions", "rooms", "sim_time_s"):
        assert getattr(first.result, name) == getattr(second.result, name)
    assert sorted(recorded(plan)) == sorted(recorded(again))


def test_the_robot_in_the_documentation_drives(launcher: Launcher, make_context, tmp_path: Path) -> None:
    (text,) = re.findall(r"^<!-- robot: indoor-navigation -->\n```py\n(.*?)^```$", PAGE.read_text(), re.M | re.S)
    shutil.copy(agent_client.__file__, tmp_path)
    (tmp_path / "robot.py").write_text(text)
    argv = [sys.executable, "robot.py"]
    plan = make_context().plan.model_copy(
        update={
            "work_dir": tmp_path / "work",
            "output_dir": tmp_path / "out",
            "simulation_application": BUILT_IN_ENVIRONMENT,
            "robot_application": ApplicationPlan(role="robot", name="careful"),
            "programs": [ProgramPlan(name="robot", role="robot", kind="application", argv=argv, folder=tmp_path)],
        }
    )
    outcome = launcher.run(plan, lambda: None)
    assert outcome.status == "Completed", outcome.failure_reason
    result = RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())
    assert result.ended_by == "agent"
    assert result.sim_time_s == pytest.approx(20.0, abs=0.1)
    assert result.metrics["distance_m"] > 1.0
    assert result.collisions == []
