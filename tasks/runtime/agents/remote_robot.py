"""Simulation side of the agent protocol: waits for the robot program, and asks it for actions."""

import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Literal, Protocol

import dm_env

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.provenance import ActionsSummary
from ....schemas.runs.variables import number_in
from ....schemas.wire.common import counted
from ....schemas.wire.errors import LaunchError
from ..episode.context import ActionError, RobotProgramError, SimulationContext
from ..episode.progress import RunStopped
from ..episode.run_results import Findings, Observer
from .action_log import ACTIONS_FILE, ActionRecorder, header_of
from .agent_client import (
    ACTION,
    ACTION_HEADER,
    END,
    ERROR,
    HELLO,
    OBSERVATION_HEADER,
    PROTOCOL,
    VERSION,
    ProtocolError,
    json_message,
)
from .agent_greeting import CONNECT_TIMEOUT_VARIABLE, CRASH, Greeter, OtherInterface
from .agent_layout import Layout
from .agent_protocol import MAX_WORDS_BYTES, ObservationWriter, RobotHello, read_action, read_words
from .agent_socket import AgentLink, AgentSocket, Closed, Message, Stop, Stopped

_MIN_SILENT_STEPS = 20
"""Number of steps without an action (about a second for most robots) from which silence is reported; shorter silences
are normal for slow controllers.
"""


class RemoteAgent:
    """Agent that gets its actions from a robot program in another process.

    In lock-step mode it waits for the answer to every observation. In free mode it keeps simulated time at real time
    multiplied by a factor, sends every observation that the robot can receive, and returns the newest action.
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
        time_limit_s: float | None = None,
        keep: Callable[[bytes], None] | None = None,
    ) -> None:
        """Takes over the connection to a robot program after the handshake.

        Args:
            link: Connection to the robot program.
            hello: The robot's greeting.
            observation: Layout of observations in messages.
            action: Layout of actions in messages.
            robot: Name of the robot application, for error messages.
            simulated_time: Function that returns the simulated time in seconds of a step number; NaN if unknown.
            control_timestep_s: Simulated seconds of a step; required in free mode.
            time_limit_s: Simulated time at which the environment ends its run; None if it has no such limit.
            keep: Called with each action that the environment gets, encoded as in the message.
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
        """The last action as received, without its step number."""
        self._sent = self._actions = 0
        self._acted_at = 0
        """Number of the observation at which the newest action arrived."""
        self._waited_s = 0.0
        self._left_at_s: float | None = None
        """Simulated time at which the program closed the connection without a message; None: it has not."""
        self._time_limit_s = time_limit_s

    def __call__(self, timestep: dm_env.TimeStep) -> Any:
        """Sends the observation to the robot program, and returns its action.

        Raises:
            StopIteration: The robot is done, or has closed the connection.
            RobotProgramError: The robot program sent a malformed message, or did not answer in time.
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
            self._left_at_s = self._simulated_time(self._number)
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
        """Returns figures about the messages exchanged with the robot program for the run's result, and any warning."""
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
        return Findings(extra={"agent": about}, notes=[*self._silence_warning(), *self._departure()])

    def _departure(self) -> list[str]:
        """Returns a note if the program left without a word, as one does that ends by mistake; else an empty list."""
        if self._left_at_s is None:
            return []
        limit = f" of {self._time_limit_s:g} s" if self._time_limit_s else " s"
        when = f"at {self._left_at_s:.1f}{limit}" if math.isfinite(self._left_at_s) else f"in step {self._number + 1}"
        return [f"the robot program left {when} without sending END, which ended the run"]

    def _silence_warning(self) -> list[str]:
        """Returns a warning if a robot in free mode sent no action for most of the run, as a hanging program does.

        The list is empty in other modes, and if the robot was not silent.
        """
        observations = self._number + 1
        silent = self._number - self._acted_at
        if self._hello.mode != "free" or silent < max(_MIN_SILENT_STEPS, observations / 2):
            return []
        actions = f"{counted(self._actions, 'action')} for {observations} observations"
        return [
            f"the robot application sent {actions}, and none after step {self._acted_at + 1}: the last was repeated"
        ]

    def end(self, ended_by: str) -> None:
        """Tells the robot program that the run is over, and by what it ended, unless it was told its end before."""
        self._link.say_last(END, {"ended_by": ended_by})

    def fail(self, text: str) -> None:
        """Tells the robot program that the run failed, and why, unless it was told its end before."""
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
    """Returns a copy of an action, as environments may keep or change the arrays that they get."""
    if isinstance(action, dict):
        return {key: _copied(item) for key, item in action.items()}
    if isinstance(action, list | tuple):
        return type(action)(_copied(item) for item in action)
    return action.copy()


CONNECT_TIMEOUT_S = 60.0

_REFUSE_EVERY_S = 0.2
"""Wall-clock seconds between two checks for robot programs that connect while ROS nodes drive; those are refused."""
_LATE = (
    "ROS nodes drive this run already; a program that is to drive by the agent socket has to connect before they "
    "publish commands, or to set ROBOMAKER_ROS to off"
)
_FAILED = "the run failed; the reason is the job's failureReason"


Agent = Callable[[dm_env.TimeStep], Any]


class RobotNodes(OtherInterface, Protocol):
    """Interface of ROS nodes that may drive the robot instead of a robot program."""

    @property
    def mode(self) -> Literal["lockstep", "free"]:
        """Mode (lock-step or free) in which the nodes' actions are received."""
        ...

    def look_in(self, environment: Any) -> None:
        """Starts looking for ROS nodes, once the simulation is ready."""
        ...

    def make_agent(self, environment: Any, stop: Stop, keep: Callable[[bytes], None]) -> Agent:
        """Returns the agent that the nodes drive; `keep` receives each action as bytes."""
        ...

    def close(self, ended_by: str | None = None) -> Findings:
        """Disconnects from the ROS nodes, and returns findings about them for the run's result.

        The run did not end normally if the reason of its end is `None` or a `RunStop`.

        Raises:
            LaunchError: The run ended normally, but the nodes never sent a command.
        """
        ...


class RemoteRobot(Observer):
    """Robot application in another process: waits for the robot program, makes its agent, and disconnects at the end.

    It listens from the beginning, and is told of the run's end as an observer (`Observer`).
    """

    next_time_s = math.inf

    def __init__(self, plan: RunPlan, robot: str, stop: Stop, nodes: RobotNodes | None = None) -> None:
        """Opens the socket to which the robot program is to connect.

        Args:
            plan: Plan of the run.
            robot: Name of the robot application.
            stop: Function that returns whether the run has to stop.
            nodes: ROS nodes that may drive the robot instead of a robot program.

        Raises:
            LaunchError: The socket cannot be opened.
        """
        self._nodes = nodes
        self._plan = plan
        self._robot = robot
        self._stop = stop
        self._socket: AgentSocket | None = AgentSocket(plan)
        self._link: AgentLink | None = None
        self._agent: RemoteAgent | None = None
        self._keeper: ActionRecorder | None = None
        self._driven_by_nodes = False
        self._refuses_again_s, self._late = 0.0, 0

    def make_agent(self, context: SimulationContext, environment: dm_env.Environment) -> Agent:
        """Waits for the robot program or for ROS nodes, and returns the agent that gets actions from them.

        Args:
            context: Context of the run, with the robot application's environment variables.
            environment: Environment in which the robot acts.

        Raises:
            LaunchError: The environment is not of a kind that such a robot can act in, or the robot's program
                did not connect in time or greeted wrongly.
            RunStopped: The run was told to stop.
        """
        observation, action = _layouts(environment)
        timestep_s = _control_timestep_s(environment)
        greeting = json_message(HELLO, _greeting(self._plan, self._robot, timestep_s, observation, action))
        assert self._socket is not None
        nodes = self._nodes
        if nodes is not None:
            nodes.look_in(environment)
        greeter = Greeter(self._socket, self._robot, self._stop, max_duration_s=self._plan.max_duration_s, other=nodes)
        try:
            greeted = greeter.greet(greeting, _connect_timeout_s(context.environment))
        except Stopped:
            raise RunStopped from None
        if greeted is None:
            assert nodes is not None
            self._keeper = ActionRecorder(self._plan.output_dir / ACTIONS_FILE, header_of(nodes.mode, action))
            self._driven_by_nodes = True
            return self._refusing_late(nodes.make_agent(environment, self._stop, self._keeper.keep))
        self._stop_listening()
        if nodes is not None:
            nodes.close()
        self._link, hello = greeted
        if hello.mode == "free" and not timestep_s:
            text = "this environment cannot run free: it has no control_timestep()"
            self._link.refuse(text)
            raise LaunchError(f"the program of robot application {self._robot}: {text}", CRASH)
        self._link.waits_at_limit = True
        # The greeting decides which further messages the robot may send.
        self._link.limits[ACTION] = max(action.size, MAX_WORDS_BYTES)
        self._keeper = ActionRecorder(self._plan.output_dir / ACTIONS_FILE, header_of(hello.mode, action))
        self._agent = RemoteAgent(
            self._link,
            hello,
            observation,
            action,
            robot=self._robot,
            simulated_time=_simulated_time(environment, timestep_s),
            control_timestep_s=timestep_s,
            time_limit_s=getattr(environment, "time_limit_s", None),
            keep=self._keeper.keep,
        )
        return self._agent

    def _refusing_late(self, agent: Agent) -> Agent:
        """Returns an agent of ROS nodes that refuses robot programs that connect during the run, at each step."""

        def drive(timestep: dm_env.TimeStep) -> Any:
            self._refuse_late()
            return agent(timestep)

        return drive

    def _refuse_late(self) -> None:
        """Refuses and counts robot programs that connect while ROS nodes drive: a rerun could not repeat such a change.

        Does nothing if it was called a moment ago, or if there is no socket.
        """
        now_s = time.monotonic()
        if self._socket is None or now_s < self._refuses_again_s:
            return
        self._refuses_again_s = now_s + _REFUSE_EVERY_S
        while (connection := self._socket.accept_waiting()) is not None:
            link = AgentLink(connection, {}, self._stop)
            link.refuse(_LATE)
            link.close()
            self._late += 1

    def actions(self) -> ActionsSummary | None:
        """Summary of the recorded actions; `None` before the end of the run, and if no log was written."""
        return self._keeper.summary if self._keeper is not None else None

    def close(self, ended_by: str | None) -> Findings:
        """Tells the robot program how the run ended, closes the connection, and returns findings for the run's result.

        Args:
            ended_by: Cause of the run's end; None if it failed.

        Returns:
            Figures and warnings about the exchange of messages.
        """
        self._refuses_again_s = 0.0
        self._refuse_late()
        self._stop_listening()
        if self._keeper is not None:
            self._keeper.close()
        of_nodes = self._nodes.close(ended_by) if self._nodes is not None else Findings()
        if self._driven_by_nodes:
            if self._keeper is not None and self._keeper.error is not None:
                of_nodes.extra["ros"]["actions_not_kept"] = self._keeper.error
            if self._late:
                of_nodes.notes.append(f"a program connected to the agent socket and did not drive: {_LATE}")
            return of_nodes
        if self._agent is None:
            if self._link is not None:
                self._link.refuse(_FAILED)
                self._link.close()
            return Findings()
        if ended_by is None:
            self._agent.fail(_FAILED)
        else:
            self._agent.end(ended_by)
        assert self._link is not None
        self._link.close()
        findings = self._agent.findings()
        if self._keeper is not None and self._keeper.error is not None:
            findings.extra["agent"]["actions_not_kept"] = self._keeper.error
        return findings

    def _stop_listening(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _greeting(
    plan: RunPlan, robot: str, control_timestep_s: float | None, observation: Layout, action: Layout
) -> dict[str, Any]:
    return {
        "protocol": PROTOCOL,
        "version": VERSION,
        "job_id": plan.job_id,
        "job_arn": plan.job_arn,
        "run_id": plan.run_id,
        "robot_application": robot,
        "seed": plan.seed,
        "world_dir": str(plan.world_dir) if plan.world_dir else None,
        "data_dir": str(plan.data_dir) if plan.data_dir else None,
        "control_timestep_s": control_timestep_s,
        "observation": observation.describe(),
        "action": action.describe(),
    }


def action_layout(environment: Any) -> Layout:
    """Returns the message layout of an environment's actions.

    Raises:
        LaunchError: The environment's actions are of a kind that cannot be sent.
    """
    action = _layout(environment, "action_spec", ACTION_HEADER.size)
    if action.left_out:
        raise LaunchError(
            f"the environment's action_spec() cannot be sent: {', '.join(action.left_out)} is no array of numbers"
        )
    return action


def _layouts(environment: Any) -> tuple[Layout, Layout]:
    return _layout(environment, "observation_spec", OBSERVATION_HEADER.size), action_layout(environment)


def _layout(environment: Any, name: str, header_bytes: int) -> Layout:
    method = getattr(environment, name, None)
    if not callable(method):
        raise LaunchError(f"the environment has no {name}(); a robot application that is a program needs it")
    try:
        return Layout(method(), header_bytes)
    except ValueError as error:
        raise LaunchError(f"the environment's {name}() cannot be sent: {error}") from error


def _control_timestep_s(environment: Any) -> float | None:
    if not callable(getattr(environment, "control_timestep", None)):
        return None
    return float(environment.control_timestep())


def _simulated_time(environment: Any, control_timestep_s: float | None) -> Callable[[int], float]:
    """Returns a function for the simulated time of a step: that of the physics, else step number × control timestep.

    Without physics and control timestep, that time is NaN.
    """
    if hasattr(getattr(environment, "physics", None), "data"):
        return lambda _: environment.physics.data.time
    return lambda number: number * (control_timestep_s or math.nan)


def _connect_timeout_s(variables: Mapping[str, str]) -> float:
    text = variables.get(CONNECT_TIMEOUT_VARIABLE)
    if text is None:
        return CONNECT_TIMEOUT_S
    timeout_s = number_in(text)
    if not (math.isfinite(timeout_s) and timeout_s > 0):
        raise LaunchError(
            f"{CONNECT_TIMEOUT_VARIABLE}: {text!r} is no time limit; it has to be seconds above 0, such as 60"
        )
    return timeout_s
