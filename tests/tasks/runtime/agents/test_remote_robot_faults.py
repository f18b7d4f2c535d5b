"""Robots that greet or answer wrongly, and environments that no such robot can drive."""

import struct
import time
from collections.abc import Callable
from typing import Any

import pytest
from helpers.remote_jobs import ARENA, Job, action, greeting, last_words

from prefect_robomaker.tasks.runtime.agents.agent_client import HELLO, SimulationError, json_message


class TestWrongGreetings:
    @pytest.mark.parametrize(
        ("sent", "texts"),
        [
            (b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", ["has type 1414012975", "one of 1, 4, 5"]),
            (struct.pack("<II", 2**32 - 1, 1), ["type 1 has 4294967295 bytes", "65536 at most"]),
            pytest.param(struct.pack("<II", 3, 1) + b"{}}", ["not JSON"], marks=pytest.mark.deep),
            (struct.pack("<II", 1, 1) + b"\xff", ["not JSON in UTF-8"]),
            pytest.param(struct.pack("<II", 60000, 1) + b"[" * 60000, ["not JSON"], marks=pytest.mark.deep),
            pytest.param(struct.pack("<II", 2, 1) + b"[]", ["not an object"], marks=pytest.mark.deep),
            (struct.pack("<II", 2, 4) + b"{}", ["ended the run before it greeted"]),
            pytest.param(struct.pack("<II", 13, 5) + b'{"error":"x"}', ["it said: x"], marks=pytest.mark.deep),
            pytest.param(struct.pack("<II", 8, 3) + bytes(8), ["type 3", "one of 1, 4, 5"], marks=pytest.mark.deep),
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
            pytest.param({"version": "1", "mode": "lockstep"}, ["version '1'"], marks=pytest.mark.deep),
            pytest.param({"version": 1}, ["mode: Field required"], marks=pytest.mark.deep),
            pytest.param({"version": 1, "mode": "fast"}, ["mode", "'lockstep' or 'free'"], marks=pytest.mark.deep),
            ({"version": 1, "mode": "free", "timeout_s": 0}, ["timeout_s", "greater than 0"]),
            pytest.param(
                {"version": 1, "mode": "free", "real_time_factor": -1}, ["real_time_factor"], marks=pytest.mark.deep
            ),
            pytest.param({"version": 1, "mode": "free", "timeout": 3}, ["timeout: Extra"], marks=pytest.mark.deep),
        ],
    )
    def test_wrong_members(self, start: Callable[..., Job], members: dict[str, Any], texts: list[str]) -> None:
        job = start()
        with job.raw() as connection:
            connection.sendall(json_message(HELLO, members))
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
            pytest.param(struct.pack("<IIQdd", 24, 3, 0, 0, 0), ["has 24 bytes"], marks=pytest.mark.deep),
            (struct.pack("<IIQd", 16, 3, 1, 0), ["answers observation 1", "has to answer 0"]),
            (struct.pack("<IIQd", 16, 3, 0, float("nan")), ["[nan]", "finite"]),
            pytest.param(struct.pack("<IIQd", 16, 3, 0, float("-inf")), ["[-inf]", "finite"], marks=pytest.mark.deep),
            (struct.pack("<II", 2**31, 3), ["2147483648 bytes", "65536 at most"]),
            (struct.pack("<II", 0, 77), ["type 77"]),
            pytest.param(struct.pack("<II", 2, 1) + b"{}", ["second greeting"], marks=pytest.mark.deep),
            pytest.param(struct.pack("<II", 2, 5) + b"{]", ["not JSON"], marks=pytest.mark.deep),
        ],
    )
    @pytest.mark.parametrize("mode", ["lockstep", pytest.param("free", marks=pytest.mark.deep)])
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
