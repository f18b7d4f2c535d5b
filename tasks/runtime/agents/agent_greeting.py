"""Handshake between a simulation and the robot program that connects to it (`docs/robot-programs.md`)."""

import math
import sys
import time
from contextlib import suppress
from typing import Protocol

from ....schemas.runs.programs import RunStop
from ....schemas.wire.errors import LaunchError
from ..episode.progress import AGENT_GONE
from .agent_client import END, ERROR, HELLO, SOCKET_VARIABLE, ProtocolError
from .agent_protocol import MAX_WORDS_BYTES, RobotHello, read_hello, read_words
from .agent_socket import AgentLink, AgentSocket, Clock, Closed, Message, Stop, Stopped

CONNECT_TIMEOUT_VARIABLE = "ROBOMAKER_AGENT_CONNECT_TIMEOUT_S"
GREETING_TIMEOUT_S = 5.0
"""Time limit in seconds for the greeting of a connected program while another program waits; without one there is no
such limit.
"""
WARN_AFTER_S = 10.0
"""Seconds without a connection after which the log warns that the robot program has not connected."""
CRASH = "RobotApplicationCrash"
"""Failure code of a job whose robot program sends a wrong greeting."""

_UNHEALTHY = "RobotApplicationHealthCheckFailure"
_LOOK_S = 0.05
_WORDS = {HELLO: MAX_WORDS_BYTES, END: MAX_WORDS_BYTES, ERROR: MAX_WORDS_BYTES}


class _MuteError(Exception):
    """Raised when the connected program sends nothing while another one waits to connect."""


class OtherInterface(Protocol):
    """Another interface through which a robot can drive the simulation, such as ROS topics."""

    def came(self) -> bool:
        """Whether a robot has connected by the other interface."""
        ...

    def missing(self) -> str:
        """Returns text about the missing robot that completes the sentence "it has to connect to the socket, ..."."""
        ...


class Greeter:
    """Waits for the robot program to connect, and does the agent protocol's handshake with it."""

    def __init__(
        self,
        listening: AgentSocket,
        robot: str,
        stop: Stop,
        clock: Clock = time.monotonic,
        max_duration_s: float = math.inf,
        other: OtherInterface | None = None,
    ) -> None:
        """Takes the simulation's listening socket, to which no program has connected yet.

        Args:
            listening: The simulation's socket for robot programs.
            robot: The robot application's name.
            stop: Function that returns whether the run has to stop.
            clock: Monotonic clock, in seconds.
            max_duration_s: The job's duration limit in seconds, for error messages.
            other: Another interface (ROS) on which a robot is awaited at the same time; a robot program that connects
                is preferred.
        """
        self._other = other
        self._max_duration_s = max_duration_s
        self._socket = listening
        self._robot = robot
        self._stop = stop
        self._clock = clock
        self._did, self._lacks = "did not connect", "connecting to"

    def greet(self, greeting: bytes, timeout_s: float) -> tuple[AgentLink, RobotHello] | None:
        """Does the handshake with connecting programs until one replies as a robot.

        Args:
            greeting: The simulation's greeting, as an encoded message.
            timeout_s: Time limit for the whole handshake, retries included.

        Returns:
            The connection, and the robot's greeting; none where the other interface has a robot.

        Raises:
            LaunchError: No robot program greeted correctly in time, or before the robot's process ended.
            Stopped: The run was told to stop.
        """
        try:
            return self._greeted(greeting, timeout_s)
        except Stopped:
            if self._stop.reason == AGENT_GONE:
                raise self._early_end_error() from None
            if self._stop.reason == RunStop.DURATION_LIMIT:
                raise self._cut() from None
            raise

    def _greeted(self, greeting: bytes, timeout_s: float) -> tuple[AgentLink, RobotHello] | None:
        deadline_s, warn_at_s = self._clock() + timeout_s, self._clock() + WARN_AFTER_S
        while True:
            try:
                until = self._other.came if self._other is not None else _never
                connection = self._socket.accept(min(deadline_s, warn_at_s), self._stop, self._clock, until)
            except TimeoutError:
                if self._clock() >= deadline_s:
                    raise self._late(timeout_s) from None
                sys.stderr.write(f"{self._text(WARN_AFTER_S)}; {self._how()}. It is waited for\n")
                sys.stderr.flush()
                warn_at_s = math.inf
                continue
            if connection is None:
                return None
            self._did, self._lacks = "connected, but did not greet", "greeting"
            link = AgentLink(connection, dict(_WORDS), self._stop, self._clock)
            try:
                return link, self._exchange(link, greeting, deadline_s)
            except (Closed, _MuteError):
                link.close()
            except TimeoutError:
                _refuse(link, self._text(timeout_s))
                raise self._late(timeout_s) from None
            except ProtocolError as error:
                _refuse(link, str(error))
                raise LaunchError(f"the program of robot application {self._robot}: {error}", CRASH) from error
            except BaseException:
                link.close()
                raise

    def _exchange(self, link: AgentLink, greeting: bytes, deadline_s: float) -> RobotHello:
        with suppress(BrokenPipeError):  # what it said before it left is still to be read
            link.send(greeting, deadline_s - self._clock())
        kind, payload = self._receive(link, deadline_s)
        if kind == ERROR:
            raise ProtocolError(f"it said: {read_words(payload).get('error')}")
        if kind == END:
            raise ProtocolError("it ended the run before it greeted")
        return read_hello(payload)

    def _receive(self, link: AgentLink, deadline_s: float) -> Message:
        patient_until_s = self._clock() + GREETING_TIMEOUT_S
        while True:
            try:
                return link.receive(min(_LOOK_S, deadline_s - self._clock()))
            except TimeoutError:
                if self._clock() >= deadline_s:
                    raise
            if self._clock() >= patient_until_s and self._socket.has_waiting_client():
                link.refuse(f"no greeting came within {GREETING_TIMEOUT_S:g} s, and another program has connected")
                raise _MuteError

    def _text(self, timeout_s: float) -> str:
        return f"the program of robot application {self._robot} {self._did} within {timeout_s:g} s"

    def _early_end_error(self) -> LaunchError:
        """Returns, without raising it, the error for a robot program that exited with code 0 before its greeting."""
        return LaunchError(
            f"the program of robot application {self._robot} ended with exit code 0 without {self._lacks} the "
            f"simulation; it has to drive it over the Unix socket that {SOCKET_VARIABLE} names"
            + (f", {self._other.missing()}" if self._other is not None else ""),
            _UNHEALTHY,
        )

    def _cut(self) -> LaunchError:
        return LaunchError(
            f"the program of robot application {self._robot} {self._did} before the job's duration limit of "
            f"{self._max_duration_s:g} s; {self._how()}",
            _UNHEALTHY,
        )

    def _how(self) -> str:
        socket = f"it has to connect to the Unix socket that {SOCKET_VARIABLE} names, here {self._socket.path}"
        return f"{socket}, {self._other.missing()}" if self._other is not None else socket

    def _late(self, timeout_s: float) -> LaunchError:
        return LaunchError(
            f"{self._text(timeout_s)}; {self._how()}. {CONNECT_TIMEOUT_VARIABLE} sets another time",
            _UNHEALTHY,
        )


def _never() -> bool:
    return False


def _refuse(link: AgentLink, text: str) -> None:
    """Tells a robot program why it was refused, and closes the connection."""
    link.refuse(text)
    link.close()
