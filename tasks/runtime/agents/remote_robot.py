"""The robot's side of a run whose robot application is a program: waits for it, greets it, lets it act."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import dm_env

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.provenance import ActionsSummary
from ....schemas.runs.variables import number_in
from ....schemas.wire.errors import LaunchError
from ..episode.context import SimulationContext
from ..episode.results import Findings, Observer
from ..episode.stops import RunStopped
from .action_log import ACTIONS_FILE, header_of
from .action_log_writer import ActionRecorder
from .agent_client import ACTION, ACTION_HEADER, HELLO, OBSERVATION_HEADER, PROTOCOL, VERSION, words
from .agent_greeting import CONNECT_TIMEOUT_VARIABLE, CRASH, Greeter
from .agent_layout import Layout
from .agent_protocol import MAX_WORDS_BYTES
from .agent_socket import AgentLink, AgentSocket, Stop, Stopped
from .remote_agent import RemoteAgent

CONNECT_TIMEOUT_S = 60.0

_FAILED = "the run failed; the reason is the job's failureReason"


class RemoteRobot(Observer):
    """The robot's side of a run whose robot application is a program.

    It listens from the beginning, and is told of the end as an observer of the run (`observers.Observer`).
    """

    next_time_s = math.inf

    def __init__(self, plan: RunPlan, robot: str, stop: Stop) -> None:
        """Listens.

        Args:
            plan: The run.
            robot: The robot application's name.
            stop: Whether the run is to stop.

        Raises:
            LaunchError: It cannot.
        """
        self._plan = plan
        self._robot = robot
        self._stop = stop
        self._socket: AgentSocket | None = AgentSocket(plan)
        self._link: AgentLink | None = None
        self._agent: RemoteAgent | None = None
        self._keeper: ActionRecorder | None = None

    def make_agent(self, context: SimulationContext, environment: dm_env.Environment) -> RemoteAgent:
        """Waits for the robot's program and greets it.

        Args:
            context: The run, with the robot application's environment variables.
            environment: What the robot is to act in.

        Raises:
            LaunchError: The environment is not of a kind that such a robot can act in, or the robot's program
                did not connect in time or greeted wrongly.
            RunStopped: The run was told to stop.
        """
        observation, action = _layouts(environment)
        timestep_s = _control_timestep_s(environment)
        greeting = words(HELLO, _greeting(self._plan, self._robot, timestep_s, observation, action))
        assert self._socket is not None
        greeter = Greeter(self._socket, self._robot, self._stop, max_duration_s=self._plan.max_duration_s)
        try:
            self._link, hello = greeter.greet(greeting, _connect_timeout_s(context.environment))
        except Stopped:
            raise RunStopped from None
        self._stop_listening()
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
            keep=self._keeper.keep,
        )
        return self._agent

    def actions(self) -> ActionsSummary | None:
        """Summary of the log of actions; None until the end, and when there is no log."""
        return self._keeper.summary if self._keeper is not None else None

    def close(self, ended_by: str | None) -> Findings:
        """Tells the robot how the run ended, and closes everything.

        Args:
            ended_by: What ended the run; None when it failed.

        Returns:
            What the result says about the conversation.
        """
        self._stop_listening()
        if self._keeper is not None:
            self._keeper.close()
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
    """How an environment's actions lie in messages.

    Raises:
        LaunchError: They cannot be sent.
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
    """Returns seconds at a time step: the physics' time, looked up anew since it may be replaced, or a count."""
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
