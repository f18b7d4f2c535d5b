"""What a robot in a process of its own costs beside one in the job's process; prints figures and asserts no time.

First with an environment that does nothing, so that nothing but the conversation is measured: microseconds a step with
the agent in process, as a client in Python, as a client in C, and what two processes take for bytes to and fro over
such a socket and nothing else. Then with Scout in a furnished flat: the same job in one process and in two, in
lock-step, which do the same steps. Runs take turns and of each step the best time counts: what else happens on a
machine only ever makes things slower.
"""

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs
from helpers.paths import REPOSITORY
from numpy.typing import NDArray

os.environ.setdefault("MUJOCO_GL", "egl")

from helpers.small_flat import BODY

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.agents import agent_client
from prefect_robomaker.tasks.runtime.agents.agent_socket import agent_socket_path
from prefect_robomaker.tasks.runtime.agents.remote_robot import RemoteRobot
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.applications.scout.agent import make_agent
from prefect_robomaker.tasks.runtime.episode.context import SimulationContext
from prefect_robomaker.tasks.runtime.episode.progress import Phase
from prefect_robomaker.tasks.runtime.episode.run_results import Episode
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

EXAMPLE = REPOSITORY / "deployments" / "specs" / "examples" / "agent_process" / "robot.c"
CLIENT = """
from prefect_robomaker.tasks.runtime.agents.agent_client import connect
with connect() as simulation:
    simulation.run(lambda step: (0.0,))
"""
SCOUT = """
import pathlib, types
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.runtime.agents.agent_client import connect
from prefect_robomaker.tasks.runtime.applications.scout import make_agent
from prefect_robomaker.tasks.runtime.episode.progress import Phase
from prefect_robomaker.tasks.runtime.recording.recording import Recorder


with connect() as simulation:
    world_dir = pathlib.Path(simulation.hello["world_dir"])
    world = World.model_validate_json((world_dir / "world.json").read_bytes())
    context = types.SimpleNamespace(world=world, world_dir=world_dir, recorder=Recorder())
    simulation.run(make_agent(context, simulation))
"""
ECHO = """
import socket, sys
echo = socket.socket(fileno=int(sys.argv[1]))
while data := echo.recv(4096):
    echo.send(data[:24])
"""
Laps = NDArray[np.float64]
STEPS = 5000
ROUNDS = 5


class Idle(dm_env.Environment):
    """Does nothing; its observation is that of the cartpole example."""

    def reset(self) -> dm_env.TimeStep:
        self._left = STEPS
        self._observation = {"position": np.zeros(2), "velocity": np.zeros(2)}
        return dm_env.restart(self._observation)

    def step(self, action: Any) -> dm_env.TimeStep:
        self._left -= 1
        if self._left == 0:
            return dm_env.termination(0.0, self._observation)
        return dm_env.transition(0.0, self._observation)

    def observation_spec(self) -> Any:
        return {"position": specs.Array((2,), float), "velocity": specs.Array((2,), float)}

    def action_spec(self) -> Any:
        return specs.BoundedArray((1,), float, -1, 1)


class Going:
    reason = ""  # these runs are not stopped


class Stopwatch:
    """Takes the time of every step, from one call of the agent to the next."""

    def __init__(self) -> None:
        self._times: list[float] = []

    def mark(self, phase: int) -> None:
        if phase == Phase.AGENT:
            self._times.append(time.perf_counter())

    def laps(self) -> NDArray[np.float64]:
        """Microseconds."""
        return 1e6 * np.diff(self._times)


def run(make_environment: Callable[[], Any], make_agent: Callable[[Any], Any]) -> tuple[Episode, Laps]:
    watch = Stopwatch()
    episode = run_episode(make_environment, make_agent, mark=watch.mark, stop=Going(), recorder=Recorder())
    return episode, watch.laps()


def best(laps: list[Laps]) -> float:
    """Microseconds a step, of each step the best."""
    return float(np.min(laps, axis=0).mean())


@contextmanager
def robot(plan: RunPlan, argv: list[str]) -> Iterator[RemoteRobot]:
    """A listening run and its robot's process."""
    remote = RemoteRobot(plan, "robot", Going())
    environ = {**os.environ, agent_client.SOCKET_VARIABLE: str(agent_socket_path(plan))}
    with subprocess.Popen(argv, env=environ, stdout=subprocess.DEVNULL) as program:
        yield remote
        remote.close("environment")
        assert program.wait(20) == 0


def run_apart(context: SimulationContext, make_environment: Callable[[], Any], argv: list[str]) -> tuple[Episode, Laps]:
    with robot(context.plan, argv) as remote:
        return run(make_environment, lambda environment: remote.make_agent(context, environment))


def scout_within(context: SimulationContext) -> tuple[Episode, Laps]:
    return run(lambda: make_environment(context), lambda environment: make_agent(context, environment))


def scout_apart(context: SimulationContext) -> tuple[Episode, Laps]:
    return run_apart(context, lambda: make_environment(context), [sys.executable, "-c", SCOUT])


def to_and_fro() -> Laps:
    """Microseconds for 88 bytes there and 24 back, as many as an observation and an action of `Idle` have."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        argv = [sys.executable, "-c", ECHO, str(theirs.fileno())]
        with subprocess.Popen(argv, pass_fds=[theirs.fileno()]) as echo:
            theirs.close()
            message, times = bytes(88), []
            for _ in range(STEPS):
                ours.send(message)
                ours.recv(4096)
                times.append(time.perf_counter())
            ours.close()
            echo.wait(10)
    return 1e6 * np.diff(times)


def make_context(tmp_path: Path, world_dir: Path | None = None) -> SimulationContext:
    plan = RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=600.0, world_dir=world_dir,
        work_dir=tmp_path, output_dir=tmp_path,
    )  # fmt: skip
    return SimulationContext(
        plan=plan, rng=np.random.default_rng(1), world=read_world(world_dir) if world_dir else None,
        world_dir=world_dir, data_dir=None, output_dir=tmp_path, environment={}, recorder=Recorder(),
    )  # fmt: skip


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_the_conversation_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    context = make_context(tmp_path)
    kinds: dict[str, Callable[[], Laps]] = {
        "in process": lambda: run(Idle, lambda environment: lambda timestep: np.zeros(1))[1],
        "client in Python": lambda: run_apart(context, Idle, [sys.executable, "-c", CLIENT])[1],
        "bytes to and fro": to_and_fro,
    }
    if shutil.which("cc"):
        subprocess.run(["cc", "-std=c99", "-O2", "-o", str(tmp_path / "robot"), str(EXAMPLE)], check=True)
        kinds["client in C"] = lambda: run_apart(context, Idle, [str(tmp_path / "robot")])[1]
    figures: dict[str, list[Laps]] = {kind: [] for kind in kinds}
    for _ in range(ROUNDS):
        for kind, measure in kinds.items():
            figures[kind].append(measure())
    with capsys.disabled():
        shown = ", ".join(f"{kind} {best(laps):.1f}" for kind, laps in figures.items())
        print(f"\nmicroseconds a step, of {STEPS}: {shown}; load {os.getloadavg()[0]:.1f}")


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_scout_in_a_flat(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "world"
    world = generate_world(WorldTemplateBody.model_validate(BODY), *seeds_for(7, 0, 0))
    write_bundle(world, folder)
    within, apart, one = [], [], None
    for _ in range(ROUNDS):
        one, laps = scout_within(make_context(tmp_path, folder))
        within.append(laps)
        two, laps = scout_apart(make_context(tmp_path, folder))
        apart.append(laps)
        assert (one.report, one.steps, one.ended_by) == (two.report, two.steps, two.ended_by)
    assert one is not None
    together_us, separate_us = best(within), best(apart)
    with capsys.disabled():
        print(
            f"\nScout in a flat, {one.steps} steps of {1000 * one.sim_time_s / one.steps:.0f} ms: microseconds a step "
            f"in process {together_us:.0f}, in its own process {separate_us:.0f}, "
            f"{separate_us / together_us:.2f} times; load {os.getloadavg()[0]:.1f}"
        )
