"""Agent of the run's loop for a robot application in a process of its own.

The process connects to a socket (`agent_socket`) and speaks the protocol of `docs/agents.md`.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import dm_env

from ..episode.context import ActionError
from ..episode.results import Findings
from ..episode.stops import RunStopped
from .agent_client import ACTION, ACTION_HEADER, END, ERROR, ProtocolError
from .agent_layout import Layout
from .agent_protocol import ObservationWriter, RobotHello, read_action, read_words
from .agent_socket import AgentLink, Closed, Message, Stopped

_MIN_SILENT_STEPS = 20
"""A second of most robots; shorter silences are a slow controller."""


class RobotProgramError(ActionError):
    """The robot program sent something wrong, or did not answer."""


class RemoteAgent:
    """Answers time steps with the actions of a robot in another process.

    In lock-step it waits for the answer to every observation. Free-running it keeps simulated time at real time,
    times a factor, sends every observation that the robot can take, and answers with the newest action.
    """

    def __init__(
        self,
        link: AgentLink,
        hello: RobotHello,
        observation: Layout,
        action: Layout,
        *,
        robot: str,
        simulated_time: Callable[[int], float],
        control_timestep_s: float | None = None,
        keep: Callable[[bytes], None] | None = None,
    ) -> None:
        """Takes over a connection on which both have greeted.

        Args:
            link: The connection.
            hello: The robot's greeting.
            observation: How observations lie in messages.
            action: How actions do.
            robot: The robot application's name, for what goes wrong.
            simulated_time: Seconds at a time step, by its number; NaN if unknown.
            control_timestep_s: Simulated seconds of a step; needed for free-running.
            keep: Told each action that the environment is given, as its arrays lie in the message.
        """
        self._link = link
        self._hello = hello
        self._writer = ObservationWriter(observation)
        self._layout = action
        self._robot = robot
        self._simulated_time = simulated_time
        self._period_s = (control_timestep_s or 0.0) / hello.real_time_factor
        self._keep = keep
        self._due_s = 0.0
        self._number = -1
        self._action: Any = None
        self._content = b""
        """The same as it came, without its number."""
        self._sent = self._actions = 0
        self._acted_at = 0
        """Number of the observation at which the newest action arrived."""
        self._waited_s = 0.0

    def __call__(self, timestep: dm_env.TimeStep) -> Any:
        """Returns the robot's action.

        Raises:
            StopIteration: The robot is done, or has closed the connection.
            RobotProgramError: It sent something wrong, or did not answer in time.
            ObservationError: The time step is not what the environment's specs say.
            RunStopped: The run was told to stop.
        """
        self._number += 1
        try:
            self._writer.write(self._number, self._simulated_time(self._number), timestep)
            action = self._in_lockstep() if self._hello.mode == "lockstep" else self._freely()
        except TimeoutError:
            raise self._refusal(
                f"observation {self._number} was not answered within {self._hello.timeout_s:g} s"
            ) from None
        except Stopped:
            raise RunStopped from None
        except Closed:
            raise StopIteration from None
        except RobotProgramError:
            raise
        except (ProtocolError, ActionError) as error:
            raise self._refusal(str(error)) from None
        # Before the environment sees it, which may not survive it.
        if self._keep is not None:
            self._keep(self._content)
        return action

    def findings(self) -> Findings:
        """Returns figures about the exchange for the run's result."""
        about: dict[str, Any] = {
            "mode": self._hello.mode,
            "observations": self._number + 1,
            "observations_dropped": self._number + 1 - self._sent,
            "actions": self._actions,
        }
        if self._hello.mode == "free":
            about["real_time_factor_asked"] = self._hello.real_time_factor
        elif self._actions:
            about["mean_answer_us"] = round(1e6 * self._waited_s / self._actions, 1)
        return Findings(extra={"agent": about}, notes=self._silence())

    def _silence(self) -> list[str]:
        """Says so if the robot runs free and was silent for most of the run, as one that hangs is."""
        observations = self._number + 1
        silent = self._number - self._acted_at
        if self._hello.mode != "free" or silent < max(_MIN_SILENT_STEPS, observations / 2):
            return []
        actions = f"{self._actions} action{'' if self._actions == 1 else 's'} for {observations} observations"
        return [
            f"the robot application sent {actions}, and none after step {self._acted_at + 1}: the last was repeated"
        ]

    def end(self, ended_by: str) -> None:
        """Tells the robot that the run is over."""
        self._link.say_last(END, {"ended_by": ended_by})

    def fail(self, text: str) -> None:
        """Tells the robot that the run failed."""
        self._link.refuse(text)

    def _in_lockstep(self) -> Any:
        began_s = time.perf_counter()
        with suppress(BrokenPipeError):  # what it said before it closed the connection is still to be read
            self._link.send(self._writer.message, self._hello.timeout_s)
        self._sent += 1
        expected = range(self._number, self._number + 1)
        action = self._understood(self._link.receive(self._hello.timeout_s), expected)
        self._waited_s += time.perf_counter() - began_s
        return action

    def _freely(self) -> Any:
        if self._actions == 0:
            action = self._in_lockstep()
            self._due_s = time.monotonic()
            return _copied(action)
        self._sent += self._link.offer(self._writer.message)
        # Lost time is not made up for: a burst of steps after a pause would be worse.
        self._due_s = max(self._due_s + self._period_s, time.monotonic())
        expected = range(self._number + 1)
        latest_s = self._due_s + self._period_s
        while (message := self._link.receive_until(self._due_s)) is not None:
            self._action = self._understood(message, expected)
            if time.monotonic() > latest_s:
                break  # it sends faster than can be read
        return _copied(self._action)

    def _understood(self, message: Message, expected: range) -> Any:
        kind, payload = message
        if kind == ACTION:
            self._action = read_action(self._layout, payload, expected)
            self._content = bytes(payload[ACTION_HEADER.size :])
            self._actions += 1
            self._acted_at = self._number
            return self._action
        if kind == ERROR:
            said = str(read_words(payload).get("error", "an error"))
            raise RobotProgramError(f"the program of robot application {self._robot} said: {said}")
        if kind == END:
            raise StopIteration
        raise ProtocolError(f"a second greeting, in place of an action (type {ACTION})")

    def _refusal(self, text: str) -> RobotProgramError:
        self._link.refuse(text)
        return RobotProgramError(f"the program of robot application {self._robot}: {text}")


def _copied(action: Any) -> Any:
    """Environments may keep or change what they are given."""
    if isinstance(action, dict):
        return {key: _copied(item) for key, item in action.items()}
    if isinstance(action, list | tuple):
        return type(action)(_copied(item) for item in action)
    return action.copy()
