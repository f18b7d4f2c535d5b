"""Robots in processes of their own: real runs, real sockets, real clients."""

import socket
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dm_env import specs
from helpers.processes import wait_for
from helpers.remote_jobs import ARENA, Job, action, greeting, last_words

from prefect_robomaker.schemas.runs.plan import RunPlan, RunResult
from prefect_robomaker.tasks.runtime.agents.agent_client import HEADER, HELLO, SimulationError, connect
from prefect_robomaker.tasks.runtime.agents.agent_socket import agent_socket_path
from prefect_robomaker.tasks.runtime.agents.remote_robot import CONNECT_TIMEOUT_VARIABLE, RemoteRobot
from prefect_robomaker.tasks.runtime.episode.run_results import Findings


def test_lockstep_to_the_end_of_the_episode(start: Callable[..., Job]) -> None:
    job = start()
    with job.connect() as simulation:
        assert (simulation.hello["job_id"], simulation.hello["seed"]) == ("sim-7", 5)
        seen = []
        for step in simulation:
            seen.append((step.step, step.observation.tolist(), step.reward, step.first()))
            simulation.act([0.5])
        assert simulation.ended_by == "environment"
    assert seen == [(i, [float(i)], None if i == 0 else 0.0, i == 0) for i in range(20)]
    result = job.result()
    assert (result.ended_by, result.metrics["steps"]) == ("environment", 20.0)
    agent = result.extra["agent"]
    assert agent.pop("mean_answer_us") > 0
    assert agent == {"mode": "lockstep", "observations": 20, "observations_dropped": 0, "actions": 20}


def test_observations_and_actions_of_every_kind(start: Callable[..., Job]) -> None:
    job = start(ARENA.format("make_unusual"))
    with job.connect() as simulation:
        spec = simulation.action_spec()
        wheels, tool = spec["arms"][0], spec["arms"][1]
        assert (wheels.name, wheels.shape, wheels.dtype) == ("wheels: rad/s, left and right", (2,), "float32")
        assert (wheels.minimum.tolist(), wheels.maximum.tolist()) == ([-1.0, -np.inf], [1.0, 2.0])
        assert (tool.minimum, tool.maximum, tool.shape) == (0, 3, ())
        assert simulation.hello["observation"]["left_out"] == ["camera/say"]
        for step in simulation:
            seen = step.observation
            assert seen["camera"]["rgb"].tolist() == np.arange(24).reshape(2, 4, 3).tolist()
            assert (seen["half"], seen["count"]) == (np.float16(0.1), step.step)
            assert seen["big"].tolist() == [2**63, 1]
            assert seen["none"].shape == (0, 3)
            assert step.time_s == 0.25 * step.step
            if step.first():
                assert (step.reward, step.discount) == (None, None)
            else:
                assert (step.reward, step.discount) == (-1.5, 1.0)
                assert seen["echo"]["grip"].dtype == bool
                assert bool(seen["echo"]["grip"]) == bool(step.step % 2)
                assert seen["echo"]["arms"][0].tolist() == [0.5, float(step.step)]
                assert seen["echo"]["arms"][1] == 3
            simulation.act({"grip": step.step % 2 == 0, "arms": [[0.5, step.step + 1], 3]})
    extra = job.result().extra
    assert extra["kinds"] == [np.dtype(specs.DiscreteArray(4).dtype).name] * 5
    assert extra["owned"] == 5, "an environment may keep the actions that it is given"


def test_large_observations(start: Callable[..., Job]) -> None:
    job = start(ARENA.format("make_camera"))
    with job.connect() as simulation:
        sizes = []
        for step in simulation:
            assert (step.observation == step.step).all()
            sizes.append(step.observation.size)
            simulation.act(0.0)
    assert sizes == [512 * 1024 * 3] * 30
    assert job.result().ended_by == "environment"


class TestFreeRunning:
    def test_keeps_pace_with_the_clock_and_takes_the_newest_action(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_timed"))
        with job.connect(mode="free", real_time_factor=0.5) as simulation:
            for step in simulation:
                for value in (0.0, float(step.step)):  # the first of them is out of date at once
                    simulation.act(value)
        extra = job.result().extra
        steps = np.diff(extra["times"])
        assert steps.sum() > 0.9 * 29 * 0.02 / 0.5, "slower than real time, not as fast as it can"
        assert extra["agent"]["mode"] == "free"
        assert set(extra["actions"]) <= set(map(float, range(30)))
        assert extra["actions"][-1] > 5

    def test_goes_on_with_the_last_action_while_the_robot_thinks(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_timed"))
        with job.connect(mode="free") as simulation:
            first = simulation.receive()
            assert first is not None
            simulation.act(7.0)
            time.sleep(0.3)
            later = simulation.receive()
            assert later is not None
            assert later.step > 1, "the newest observation is taken, not the next"
            assert list(simulation)
            simulation.act(8.0)  # too late, and no error
            assert simulation.ended_by == "environment"
        assert job.result().extra["actions"] == [7.0] * 30

    def test_leaves_out_observations_that_a_slow_robot_has_no_room_for(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_camera"))
        with job.connect(mode="free", real_time_factor=4.0) as simulation:
            simulation.receive()
            simulation.act(0.0)
            time.sleep(0.1)
            seen = []
            for step in simulation:
                assert (step.observation == step.step).all(), "each is whole"
                seen.append(step.step)
                time.sleep(0.1)
        assert seen == sorted(set(seen))
        agent = job.result().extra["agent"]
        assert agent["observations_dropped"] > 0
        assert agent["observations"] == 30

    @pytest.mark.deep
    def test_a_flood_of_actions_does_not_stop_time(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_timed"))
        with suppress(SimulationError), job.connect(mode="free") as simulation:
            simulation.receive()
            while simulation.ended_by is None:
                simulation.act(1.0)
        extra = job.result().extra
        assert len(extra["times"]) == 30
        assert extra["agent"]["actions"] > 100

    def test_needs_an_environment_that_says_how_long_a_step_is(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("no_clock"))
        with job.connect(mode="free") as simulation, pytest.raises(SimulationError, match="has no control_timestep"):
            simulation.receive()
        job.assert_failed("RobotApplicationCrash", "this environment cannot run free")


class TestEnds:
    def test_the_robot_says_that_it_is_done(self, start: Callable[..., Job]) -> None:
        job = start()

        def agent(step: Any) -> list[float]:
            if step.observation[0] == 3:
                raise StopIteration
            return [0.0]

        with job.connect() as simulation:
            simulation.run(agent)
        result = job.result()
        assert (result.ended_by, result.metrics["steps"]) == ("agent", 3.0)
        assert not any("left" in note for note in result.notes), "it said so"

    @pytest.mark.parametrize("unread", [False, True])
    def test_the_robot_is_gone(self, start: Callable[..., Job], unread: bool) -> None:
        job = start()
        simulation = job.connect()
        for _ in range(4):
            assert simulation.receive() is not None
            simulation.act([0.0])
        if not unread:
            simulation.receive()
        simulation.close()  # its exit code says whether that was a crash: that is for others to judge
        result = job.result()
        assert result.ended_by == "agent"
        assert result.notes[0] == "the robot program left at 0.4 s without sending END, which ended the run"

    def test_when_the_robot_left_of_how_long_is_told(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_timed"))
        simulation = job.connect()
        for _ in range(5):
            simulation.receive()
            simulation.act(0.0)
        simulation.close()
        note = "the robot program left at 0.1 of 0.6 s without sending END, which ended the run"
        assert job.result().notes[0] == note

    def test_the_robot_says_what_broke(self, start: Callable[..., Job]) -> None:
        job = start()
        with pytest.raises(ZeroDivisionError), job.connect() as simulation:
            simulation.run(lambda step: [1 / 0])
        job.assert_failed("RobotApplicationCrash", "said: ZeroDivisionError: division by zero")

    def test_the_environment_breaks(self, start: Callable[..., Job]) -> None:
        job = start("raising")
        with pytest.raises(SimulationError, match="the run failed"), job.connect() as simulation:
            simulation.run(lambda step: [0.0])
        outcome = job.outcome()
        assert outcome.failure_code == "SimulationApplicationCrash"
        assert "the table is on fire" in (outcome.failure_reason or "")

    @pytest.mark.parametrize("when", ["before it connects", "before it greets", "before it answers"])
    def test_a_run_is_stopped_while_the_robot_is_waited_for(self, start: Callable[..., Job], when: str) -> None:
        job = start()
        connection = simulation = None
        if when == "before it greets":
            connection = job.raw()
            connection.recv(100)
        elif when == "before it answers":
            simulation = job.connect()
            simulation.receive()
        else:
            while not job.path.exists():
                time.sleep(0.02)
        job.cancel = True
        assert job.outcome().status == "Canceled"
        result = RunResult.model_validate_json((job.plan.output_dir / "result.json").read_bytes())
        assert result.ended_by == "canceled", "a run that is killed leaves no result"
        assert (simulation is not None) == (when == "before it answers")
        if simulation is not None:
            assert simulation.receive() is None
            assert simulation.ended_by == "canceled"
            simulation.close()
        if connection is not None:
            connection.close()

    def test_the_duration_limit(self, start: Callable[..., Job]) -> None:
        job = start(max_duration_s=5.0)
        with job.connect() as simulation:
            simulation.receive()
            assert simulation.receive() is None
            assert simulation.ended_by == "duration limit"
        assert (job.result().ended_by, job.outcome().timed_out) == ("duration limit", True)


class TestTimeLimits:
    def test_no_robot_connects(self, start: Callable[..., Job]) -> None:
        job = start(robot={CONNECT_TIMEOUT_VARIABLE: "0.3"})
        job.assert_failed(
            "RobotApplicationHealthCheckFailure",
            "did not connect within 0.3 s",
            str(job.path),
            CONNECT_TIMEOUT_VARIABLE,
        )

    @pytest.mark.parametrize(
        "limit", ["soon", "nan", *(pytest.param(limit, marks=pytest.mark.deep) for limit in ("0", "-1", "inf"))]
    )
    def test_a_limit_that_is_none(self, start: Callable[..., Job], limit: str) -> None:
        start(robot={CONNECT_TIMEOUT_VARIABLE: limit}).assert_failed("InvalidInput", repr(limit), "seconds above 0")

    def test_somebody_connects_and_says_nothing(self, start: Callable[..., Job]) -> None:
        job = start(robot={CONNECT_TIMEOUT_VARIABLE: "0.5"})
        with job.raw() as connection:
            assert "did not greet within 0.5 s" in last_words(connection)
        job.assert_failed("RobotApplicationHealthCheckFailure", "connected, but did not greet")

    def test_somebody_greets_one_letter_at_a_time(self, start: Callable[..., Job]) -> None:
        job = start(robot={CONNECT_TIMEOUT_VARIABLE: "0.5"})
        with job.raw() as connection, suppress(OSError):
            for byte in greeting(mode="lockstep"):
                connection.sendall(bytes([byte]))
                time.sleep(0.03)
        job.assert_failed("RobotApplicationHealthCheckFailure", "did not greet")

    @pytest.mark.parametrize("mode", ["lockstep", "free"])
    def test_no_answer(self, start: Callable[..., Job], mode: str) -> None:
        job = start()
        simulation = job.connect(mode=mode, timeout_s=0.3)
        assert simulation.receive() is not None
        with pytest.raises(SimulationError, match=r"observation 0 was not answered within 0\.3 s"):
            simulation.receive()
        simulation.close()
        job.assert_failed("RobotApplicationCrash", "observation 0 was not answered within 0.3 s")

    def test_an_answer_one_byte_at_a_time(self, start: Callable[..., Job]) -> None:
        job = start()
        with job.raw() as connection, suppress(OSError):
            connection.sendall(greeting(mode="lockstep", timeout_s=0.4))
            for byte in action(0, 0.0):
                connection.sendall(bytes([byte]))
                time.sleep(0.05)
        job.assert_failed("RobotApplicationCrash", "was not answered within 0.4 s")

    def test_a_robot_that_does_not_read(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_camera"))
        with job.raw() as connection:
            connection.sendall(greeting(mode="lockstep", timeout_s=0.4))
            job.assert_failed("RobotApplicationCrash", "observation 0 was not answered within 0.4 s")


def test_only_this_user_reaches_the_socket_and_any_user_of_a_container(start: Callable[..., Job]) -> None:
    job = start()
    job.raw().close()
    # The folder that a container gets is open, the one above it closed.
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (job.path.parent.parent, job.path.parent, job.path)]
    assert modes == [0o700, 0o755, 0o666]
    assert [path.name for path in job.path.parent.iterdir()] == [job.path.name]


class Nodes:
    """ROS nodes that are there once they are looked for."""

    mode = "free"

    def __init__(self, came: Callable[[], None] = lambda: None) -> None:
        self._came = came

    def look_in(self, environment: Any) -> None: ...

    def came(self) -> bool:
        self._came()
        return True

    def missing(self) -> str:
        return "or nodes"

    def make_agent(self, *_: Any) -> Callable[[Any], Any]:
        return lambda _: np.zeros(1)

    def close(self, ended_by: str | None = None) -> Findings:
        del ended_by
        return Findings({"ros": {}})


def greeted_in(plan: RunPlan, nodes: Nodes) -> tuple[RemoteRobot, Any]:
    plan.work_dir.mkdir(parents=True)
    plan.output_dir.mkdir(parents=True)
    array = specs.Array((1,), float)
    environment: Any = SimpleNamespace(observation_spec=lambda: array, action_spec=lambda: array)
    remote = RemoteRobot(plan, "driver", SimpleNamespace(reason=""), nodes)  # pyright: ignore[reportArgumentType]
    return remote, remote.make_agent(SimpleNamespace(environment={}), environment)  # pyright: ignore[reportArgumentType]


def test_a_program_that_connects_after_ros_nodes_came_is_told_so_at_once(
    make_plan: Callable[..., RunPlan],
) -> None:
    plan = make_plan()
    remote, agent = greeted_in(plan, Nodes())
    said: list[str] = []

    def client() -> None:
        try:
            connect(path=str(agent_socket_path(plan)), connect_timeout_s=200.0)
        except SimulationError as error:
            said.append(str(error))

    late = Thread(target=client)
    late.start()
    wait_for(lambda: (agent(None), said)[1], "the refusal")
    late.join()
    assert said[0].startswith("ROS nodes drive this run already; a program that is to drive by the agent socket has to")
    assert "ROBOMAKER_ROS to off" in said[0]
    (note,) = remote.close("environment").notes
    assert note.startswith("a program connected to the agent socket and did not drive: ROS nodes drive")
    assert not agent_socket_path(plan).exists()


def test_a_program_that_connects_as_ros_nodes_come_goes_first(make_plan: Callable[..., RunPlan]) -> None:
    plan = make_plan()
    clients: list[Thread] = []

    def come() -> None:
        """Nodes and a program, in the same moment."""
        if not clients:
            clients.append(Thread(target=drives))
            clients[0].start()
            wait_for(begun.is_set, "the connection")

    begun = Event()
    kinds: list[int] = []

    def drives() -> None:
        with socket.socket(socket.AF_UNIX) as program:
            program.connect(str(agent_socket_path(plan)))
            begun.set()
            kinds.append(HEADER.unpack(program.recv(HEADER.size, socket.MSG_WAITALL))[1])

    remote, agent = greeted_in(plan, Nodes(come))
    agent(None)
    clients[0].join()
    remote.close("environment")
    assert kinds == [HELLO], "the simulation greeted the program, before it let nodes drive in its place"
