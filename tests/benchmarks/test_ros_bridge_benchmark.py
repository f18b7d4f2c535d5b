"""Processor time that the ROS 2 bridge adds to a step of Scout; prints figures, and a ratio in one run.

Scout in a furnished flat is told one velocity, by a function or by a node, whose messages and commands are real DDS: a
second process subscribes every topic. Both take turns, and of each the best round counts. Processor time of the whole
process is counted, with the threads of DDS. Then an rclpy node answers each scan, in lock-step.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.client_environments import rclpy_environment
from helpers.processes import wait_for
from helpers.small_flat import BODY

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.ros_options import RosOptions, RosPlan
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.episode.context import SimulationContext
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder, Recorder
from prefect_robomaker.tasks.runtime.ros.bridge_recorder import TOPICS
from prefect_robomaker.tasks.runtime.ros.ros_robot import RosBridge
from prefect_robomaker.tasks.simulations.ros.ros_domains import own_domain
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(600)]

STEPS, ROUNDS = 1000, 6
NODE = """
import sys, time
from prefect_robomaker.tasks.runtime.ros.bridge_recorder import TOPICS
from prefect_robomaker.tasks.runtime.ros.dds import Participant, Reach
node = Participant(int(sys.argv[1]), Reach())
readers = [
    node.reader(each.name, each.ros_type, is_reliable=True, is_latched=each.is_latched)
    for each in TOPICS.values()
    if each.name in sys.argv[2:]
]
commands = node.writer("/cmd_vel", "geometry_msgs/msg/Twist", is_latched=False, depth=10)
while True:
    for reader in readers:
        for _ in reader.take():
            pass
    commands.write(b"\\0\\1\\0\\0" + bytes(48))
    time.sleep(0.05)
"""
RCLPY = """
import rclpy
from geometry_msgs.msg import Twist
from rclpy.node import Node
from sensor_msgs.msg import LaserScan
rclpy.init()
node = Node("driver")
commands = node.create_publisher(Twist, "/cmd_vel", 10)
node.create_subscription(LaserScan, "/scan", lambda _: commands.publish(Twist()), 10)
rclpy.spin(node)
"""

Scout = Callable[[Recorder], Any]


@pytest.fixture
def scout(tmp_path: Path) -> Scout:
    """Makes Scout's environment in a furnished flat."""
    generated = generate_world(WorldTemplateBody.model_validate({**BODY, "Version": "2"}), *seeds_for(3, 0, 0))
    write_bundle(generated, tmp_path / "world")
    plan = RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run", seed=1, max_duration_s=600, work_dir=tmp_path, output_dir=tmp_path
    )

    def make(recorder: Recorder) -> Any:
        limit = {"ROBOMAKER_SIM_TIME_LIMIT_S": "100000"}
        world = read_world(tmp_path / "world")
        context = SimulationContext(
            plan, np.random.default_rng(1), world, tmp_path / "world", None, tmp_path, limit, recorder
        )
        return make_environment(context)

    return make


def nodes_of(domain: int, recorder: Recorder, **options: Any) -> RosBridge:
    plan = SimpleNamespace(ros=RosPlan(suite=2, domain=domain, options=RosOptions.model_validate(options)))
    return RosBridge(plan, "driver", recorder)  # pyright: ignore[reportArgumentType]


def cpu_us(environment: Any, agent: Callable[[Any], Any], timestep: Any, steps: int = STEPS) -> tuple[float, Any]:
    began_s = time.process_time()
    for _ in range(steps):
        timestep = environment.step(agent(timestep))
    return 1e6 * (time.process_time() - began_s) / steps, timestep


@pytest.mark.parametrize("topics", [["/clock", "/scan"], ["/clock", "/tf", "/odom", "/scan"], list(TOPICS)], ids=len)
def test_the_bridge_costs_a_part_of_a_step(scout: Scout, tmp_path: Path, topics: list[str]) -> None:
    action = np.array((0.2, 0.5))
    with own_domain("benchmark") as domain:
        node = subprocess.Popen([sys.executable, "-c", NODE, str(domain), *topics])
        try:
            (tmp_path / "alone").mkdir()
            alone = scout(McapRecorder(tmp_path / "alone" / "r.mcap"))
            (tmp_path / "bridged").mkdir()
            bridge = nodes_of(
                domain, McapRecorder(tmp_path / "bridged" / "r.mcap"), time="free", real_time_factor=1000.0
            )
            bridged = scout(bridge.recorder)
            bridge.look_in(bridged)
            wait_for(bridge.came, "the node")
            agent = bridge.make_agent(bridged, SimpleNamespace(reason=""), lambda _: None)
            steps = {
                "alone": (alone, lambda _: action),
                "bridged": (bridged, lambda timestep: _driven(agent, timestep)),
            }

            def _driven(asked: Any, timestep: Any) -> Any:
                asked(timestep)
                return action

            timesteps = {name: environment.reset() for name, (environment, _) in steps.items()}
            best = dict.fromkeys(steps, 1e9)
            for _ in range(ROUNDS):
                for name, (environment, answer) in steps.items():
                    took_us, timesteps[name] = cpu_us(environment, answer, timesteps[name])
                    best[name] = min(best[name], took_us)
            heard = bridge.close(None).extra["ros"]["heard"]
        finally:
            node.kill()
            node.wait()
    ratio = best["bridged"] / best["alone"]
    print(f"\na step of Scout {best['alone']:.0f} us, with the bridge {best['bridged']:.0f} us: {ratio:.3f}; {heard}")


def test_lockstep_is_many_times_faster_than_real_time(
    scout: Scout, tmp_path: Path, pytestconfig: pytest.Config
) -> None:
    python = rclpy_environment(pytestconfig) / "python"
    with own_domain("benchmark") as domain:
        environ = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        node = subprocess.Popen([python, "-c", RCLPY], env=environ)
        try:
            bridge = nodes_of(domain, McapRecorder(tmp_path / "r.mcap"), time="lockstep")
            environment = scout(bridge.recorder)
            bridge.look_in(environment)
            wait_for(bridge.came, "the node")
            began_s = time.perf_counter()
            agent = bridge.make_agent(environment, SimpleNamespace(reason=""), lambda _: None)
            timestep = environment.reset()
            timestep = environment.step(agent(timestep))
            first_s = time.perf_counter() - began_s
            began_s = time.perf_counter()
            for _ in range(STEPS):
                timestep = environment.step(agent(timestep))
            took_s = time.perf_counter() - began_s
            about = bridge.close(None).extra["ros"]
        finally:
            node.kill()
            node.wait()
    assert about["unanswered"] == 0
    print(f"\nlock-step with rclpy: {STEPS * 0.05 / took_s:.1f} times real time; the first step {first_s:.2f} s")
