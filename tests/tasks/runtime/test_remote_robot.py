"""Robots in processes of their own: real runs, real sockets, real clients."""

import json
import socket
import stat
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from prefect_robomaker.schemas.simulation_run import ApplicationPlan, RunOutcome, RunPlan, RunResult
from prefect_robomaker.tasks.runtime.agent_client import HELLO, Simulation, SimulationError, connect, words
from prefect_robomaker.tasks.runtime.agent_socket import agent_socket_path
from prefect_robomaker.tasks.runtime.launcher import Launcher
from prefect_robomaker.tasks.runtime.remote_robot import CONNECT_TIMEOUT_VARIABLE

BUNDLE = Path(__file__).parent / "bundles" / "trouble"
ARENA = "trouble.unusual_arena.{}"
MakePlan = Callable[..., RunPlan]


class Job:
    """A run whose robot is whoever connects."""

    def __init__(self, launcher: Launcher, plan: RunPlan) -> None:
        self.plan = plan
        self.path = agent_socket_path(plan)
        self.cancel = False
        self._outcome: RunOutcome | None = None
        self._thread = threading.Thread(target=self._carry_out, args=[launcher])
        self._thread.start()

    def _carry_out(self, launcher: Launcher) -> None:
        self._outcome = launcher.run(self.plan, lambda: "canceled" if self.cancel else None)

    def connect(self, **options: Any) -> Simulation:
        return connect(str(self.path), **options)

    def raw(self) -> socket.socket:
        """A connection that says nothing by itself."""
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(30)
        deadline = time.monotonic() + 30
        while True:
            try:
                connection.connect(str(self.path))
                return connection
            except OSError:
                assert time.monotonic() < deadline
                time.sleep(0.02)

    def outcome(self) -> RunOutcome:
        self._thread.join(40)
        assert self._outcome is not None, "the run has not ended"
        return self._outcome

    def result(self) -> RunResult:
        assert self.outcome().status == "Completed", self.outcome().failure_reason
        return RunResult.model_validate_json((self.plan.output_dir / "result.json").read_bytes())

    def assert_failed(self, code: str, *texts: str) -> None:
        outcome = self.outcome()
        assert (outcome.status, outcome.failure_code) == ("Failed", code), outcome
        for text in ("driver", *texts):
            assert text in (outcome.failure_reason or "")


@pytest.fixture
def start(launcher: Launcher, make_plan: MakePlan) -> Iterator[Callable[..., Job]]:
    """Starts a run of the `trouble` bundle whose robot application is a program."""
    jobs = []

    def start(environment: str = "make_environment", robot: dict[str, str] | None = None, **members: Any) -> Job:
        if "." in environment:
            members["simulation_application"] = ApplicationPlan(
                role="simulation", name="arena", attribute=environment, path=BUNDLE
            )
        plan = make_plan(
            environment,
            robot_application=ApplicationPlan(role="robot", name="driver", environment_variables=robot or {}),
            **members,
        )
        jobs.append(Job(launcher, plan))
        return jobs[-1]

    yield start
    for job in jobs:
        job.cancel = True
        job.outcome()
        assert not job.path.exists()


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
        with job.connect(mode="free", real_time_factor=2.0) as simulation:
            for step in simulation:
                for value in (0.0, float(step.step)):  # the first of them is out of date at once
                    simulation.act(value)
        extra = job.result().extra
        steps = np.diff(extra["times"])
        assert 0.9 * 29 * 0.02 / 2 < steps.sum() < 29 * 0.02, "faster than real time, not as fast as it can"
        assert extra["agent"]["mode"] == "free"
        assert set(extra["actions"]) <= set(map(float, range(30)))
        assert extra["actions"][-1] > 20

    def test_goes_on_with_the_last_action_while_the_robot_thinks(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_timed"))
        with job.connect(mode="free") as simulation:
            first = simulation.receive()
            assert first is not None
            simulation.act(7.0)
            time.sleep(0.3)
            later = simulation.receive()
            assert later is not None
            assert later.step > 3, "the newest observation is taken, not the next"
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
                time.sleep(0.04)
        assert seen == sorted(set(seen))
        agent = job.result().extra["agent"]
        assert agent["observations_dropped"] > 0
        assert agent["observations"] == 30

    def test_a_flood_of_actions_does_not_stop_time(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_timed"))
        with suppress(SimulationError), job.connect(mode="free") as simulation:
            simulation.receive()
            while simulation.ended_by is None:
                simulation.act(1.0)
        extra = job.result().extra
        assert extra["times"][-1] - extra["times"][0] < 2.0
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
        assert job.result().ended_by == "agent"

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
        connection = None
        if when == "before it greets":
            connection = job.raw()
            connection.recv(100)
        elif when == "before it answers":
            simulation = job.connect()
            simulation.receive()
        else:
            while not job.path.exists():
                time.sleep(0.02)
        asked_s = time.monotonic()
        job.cancel = True
        assert job.outcome().status == "Canceled"
        assert time.monotonic() - asked_s < 0.9, "before it would have been killed"
        if when == "before it answers":
            assert simulation.receive() is None
            assert simulation.ended_by == "canceled"
            simulation.close()
        if connection is not None:
            connection.close()

    def test_the_duration_limit(self, start: Callable[..., Job]) -> None:
        job = start(max_duration_s=1.5)
        with job.connect() as simulation:
            simulation.receive()
            assert simulation.receive() is None
            assert simulation.ended_by == "duration limit"
        assert (job.result().ended_by, job.outcome().timed_out) == ("duration limit", True)


class TestTimeLimits:
    def test_nobody_connects(self, start: Callable[..., Job]) -> None:
        job = start(robot={CONNECT_TIMEOUT_VARIABLE: "0.3"})
        job.assert_failed(
            "RobotApplicationHealthCheckFailure",
            "did not connect within 0.3 s",
            str(job.path),
            CONNECT_TIMEOUT_VARIABLE,
        )

    @pytest.mark.parametrize("limit", ["soon", "0", "-1", "nan", "inf"])
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


class TestWrongGreetings:
    @pytest.mark.parametrize(
        ("sent", "texts"),
        [
            (b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", ["has type 1414012975", "one of 1, 4, 5"]),
            (struct.pack("<II", 2**32 - 1, 1), ["type 1 has 4294967295 bytes", "65536 at most"]),
            (struct.pack("<II", 3, 1) + b"{}}", ["not JSON"]),
            (struct.pack("<II", 1, 1) + b"\xff", ["not JSON in UTF-8"]),
            (struct.pack("<II", 60000, 1) + b"[" * 60000, ["not JSON"]),
            (struct.pack("<II", 2, 1) + b"[]", ["not an object"]),
            (struct.pack("<II", 2, 4) + b"{}", ["ended the run before it greeted"]),
            (struct.pack("<II", 13, 5) + b'{"error":"x"}', ["it said: x"]),
            (struct.pack("<II", 8, 3) + bytes(8), ["type 3", "one of 1, 4, 5"]),
        ],
    )
    def test_no_greeting(self, start: Callable[..., Job], sent: bytes, texts: list[str]) -> None:
        job = start()
        with job.raw() as connection:
            connection.sendall(sent)
            said = last_words(connection)
        for text in texts:
            assert text in said
        job.assert_failed("RobotApplicationCrash", *texts)

    @pytest.mark.parametrize(
        ("members", "texts"),
        [
            ({"version": 2, "mode": "lockstep"}, ["version 2", "speaks 1"]),
            ({"version": "1", "mode": "lockstep"}, ["version '1'"]),
            ({"version": 1}, ["mode: Field required"]),
            ({"version": 1, "mode": "fast"}, ["mode", "'lockstep' or 'free'"]),
            ({"version": 1, "mode": "free", "timeout_s": 0}, ["timeout_s", "greater than 0"]),
            ({"version": 1, "mode": "free", "real_time_factor": -1}, ["real_time_factor"]),
            ({"version": 1, "mode": "free", "timeout": 3}, ["timeout: Extra"]),
        ],
    )
    def test_wrong_members(self, start: Callable[..., Job], members: dict[str, Any], texts: list[str]) -> None:
        job = start()
        with job.raw() as connection:
            connection.sendall(words(HELLO, members))
            said = last_words(connection)
        for text in texts:
            assert text in said
        job.assert_failed("RobotApplicationCrash", *texts)

    def test_half_a_greeting(self, start: Callable[..., Job]) -> None:
        job = start()
        with job.raw() as connection:
            connection.sendall(greeting(mode="lockstep")[:20])
        job.assert_failed("RobotApplicationCrash", "closed in the middle of a message")

    def test_who_looks_in_and_leaves_was_no_robot(self, start: Callable[..., Job]) -> None:
        job = start()
        for _ in range(3):
            job.raw().close()
        with job.connect() as simulation:
            simulation.run(lambda step: [0.0])
        assert job.result().ended_by == "environment"

    def test_a_second_robot_is_refused(self, start: Callable[..., Job]) -> None:
        job = start()
        with job.connect() as simulation:
            simulation.receive()
            with pytest.raises(SimulationError, match="no simulation listens"):
                job.connect(connect_timeout_s=0.1)
            simulation.act([0.0])
            simulation.run(lambda step: [0.0])
        assert job.result().ended_by == "environment"


class TestWrongAnswers:
    @pytest.mark.parametrize(
        ("sent", "texts"),
        [
            (struct.pack("<IIQ", 8, 3, 0), ["has 8 bytes", "to have 16", "float64[1]"]),
            (struct.pack("<IIQdd", 24, 3, 0, 0, 0), ["has 24 bytes"]),
            (struct.pack("<IIQd", 16, 3, 1, 0), ["answers observation 1", "has to answer 0"]),
            (struct.pack("<IIQd", 16, 3, 0, float("nan")), ["[nan]", "finite"]),
            (struct.pack("<IIQd", 16, 3, 0, float("-inf")), ["[-inf]", "finite"]),
            (struct.pack("<II", 2**31, 3), ["2147483648 bytes", "65536 at most"]),
            (struct.pack("<II", 0, 77), ["type 77"]),
            (struct.pack("<II", 2, 1) + b"{}", ["second greeting"]),
            (struct.pack("<II", 2, 5) + b"{]", ["not JSON"]),
        ],
    )
    @pytest.mark.parametrize("mode", ["lockstep", "free"])
    def test_the_robot_is_told(self, start: Callable[..., Job], sent: bytes, texts: list[str], mode: str) -> None:
        job = start()
        with job.raw() as connection:
            connection.sendall(greeting(mode=mode) + sent)
            said = last_words(connection)
        for text in texts:
            assert text in said
        job.assert_failed("RobotApplicationCrash", *texts)

    def test_two_answers_to_one_observation(self, start: Callable[..., Job]) -> None:
        job = start()
        with job.raw() as connection:
            connection.sendall(greeting(mode="lockstep") + 2 * action(0, 0.0))
            assert "answers observation 0; it has to answer 1" in last_words(connection)
        job.assert_failed("RobotApplicationCrash", "answers observation 0")

    def test_later_in_free_mode(self, start: Callable[..., Job]) -> None:
        job = start()
        with job.raw() as connection:
            connection.sendall(greeting(mode="free") + action(0, 1.0))
            time.sleep(0.15)
            connection.sendall(action(99, 1.0))
            assert "answers observation 99" in last_words(connection)
        job.assert_failed("RobotApplicationCrash", "it has to answer 0 to")

    def test_half_an_answer(self, start: Callable[..., Job]) -> None:
        job = start()
        with job.raw() as connection:
            connection.sendall(greeting(mode="lockstep") + action(0, 0.0)[:-1])
        job.assert_failed("RobotApplicationCrash", "closed in the middle of a message")

    def test_a_truth_that_is_neither(self, start: Callable[..., Job]) -> None:
        job = start(ARENA.format("make_unusual"))
        with job.raw() as connection:
            connection.sendall(greeting(mode="lockstep") + struct.pack("<IIQB23x", 32, 3, 0, 2))
            assert "grip has bytes that are neither 0 nor 1" in last_words(connection)
        job.assert_failed("RobotApplicationCrash", "of type bool")


class TestWrongEnvironments:
    @pytest.mark.parametrize(
        ("arena", "texts"),
        [
            ("wrong_shape", ["the observation is float64[3]", "its spec says int64[]", "in step 3"]),
            ("wrong_type", ["the observation is float64[]", "its spec says int64[]"]),
            ("wrong_structure", ["the observation is", "its spec says int64[]"]),
        ],
    )
    def test_observations_that_are_not_what_their_specs_say(
        self, start: Callable[..., Job], arena: str, texts: list[str]
    ) -> None:
        job = start(ARENA.format(arena))
        with pytest.raises(SimulationError, match="the run failed"), job.connect() as simulation:
            simulation.run(lambda step: 0.0)
        outcome = job.outcome()
        assert outcome.failure_code == "SimulationApplicationCrash"
        for text in ("arena", "ObservationError", *texts):
            assert text in (outcome.failure_reason or "")

    @pytest.mark.parametrize(
        ("arena", "texts"),
        [("hopeless", ["action_spec()", "say is no array of numbers"]), ("no_spec", ["has no observation_spec()"])],
    )
    def test_environments_for_no_such_robot(self, start: Callable[..., Job], arena: str, texts: list[str]) -> None:
        start(ARENA.format(arena)).assert_failed("InvalidInput", *texts)


def test_only_this_user_reaches_the_socket_and_any_user_of_a_container(start: Callable[..., Job]) -> None:
    job = start()
    job.raw().close()
    # The folder that a container gets is open, the one above it closed.
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (job.path.parent.parent, job.path.parent, job.path)]
    assert modes == [0o700, 0o755, 0o666]
    assert [path.name for path in job.path.parent.iterdir()] == [job.path.name]


def greeting(**members: Any) -> bytes:
    return words(HELLO, {"version": 1, **members})


def action(number: int, value: float) -> bytes:
    return struct.pack("<IIQd", 16, 3, number, value)


def last_words(connection: socket.socket) -> str:
    """What the simulation said before it closed the connection."""
    received = b""
    with suppress(ConnectionResetError):
        while data := connection.recv(65536):
            received += data
    while received:
        length, kind = struct.unpack_from("<II", received)
        content, received = received[8 : 8 + length], received[8 + length :]
    assert kind == 5
    return json.loads(content)["error"]
