"""Robot interface for ROS nodes: publishes topics and receives velocity commands, in ROS 1 or ROS 2."""

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import dm_env
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import RunStop
from ....schemas.runs.ros_options import RosOptions, RosPlan, Suite
from ....schemas.wire.common import counted
from ....schemas.wire.errors import LaunchError
from ..episode.context import RobotProgramError
from ..episode.run_results import Findings
from ..recording import messages as ros
from ..recording.recording import Frames, Recorder
from ..robots.drives import RawDrive
from ..robots.robot import robot_of
from .bridge_recorder import TOPICS, BridgeRecorder
from .dds import Reach
from .dds_wire import DdsWire
from .ros1_wire import Ros1Wire
from .simulated_time import Lockstep, TimerNodeError, Timing, make_timing
from .wire import STILL, Command, Peers, Wire

COMMANDS = "/cmd_vel"
_SETTLE_S = 0.5
"""Seconds to wait after a publisher was discovered: it may not have discovered this node yet, and first messages would
be lost.
"""
_LISTENERS_S = 10.0
"""Wall-clock seconds after which simulated time starts for nodes that subscribe but send no commands yet: some wait for
the clock.
"""
_LOOK_S = 0.5
"""Wall-clock time between two checks of which nodes are connected."""
_RETURN_S = 10.0
"""Wall-clock seconds in which command publishers that have left may return, as respawned nodes do."""
_FIRST_COMMAND_S = 60.0
_MOST_WALL_STAMP_S = 1e6
"""Time stamp in seconds above which it is of a wall clock: twelve days of simulated time."""
_UNHEALTHY, _CRASH = "RobotApplicationHealthCheckFailure", "RobotApplicationCrash"
_CLOCK = "/clock"


def make_wire(plan: RunPlan, bridge: RosPlan) -> Wire:
    """Makes the connection to a run's ROS nodes.

    Args:
        plan: Plan of the run.
        bridge: Plan of the run's ROS bridge, with all options.
    """
    options = bridge.options
    if bridge.suite == 1:
        return Ros1Wire(plan)
    reach = Reach(tuple(options.peers), options.interface)
    return DdsWire(bridge.domain, reach, is_reliable=options.time == "lockstep")


class RosBridge:
    """ROS bridge of a run: publishes the simulation's topics, and makes an agent that ROS nodes drive."""

    def __init__(self, plan: RunPlan, robot: str, recorder: Recorder, clock: Callable[[], float] = time.monotonic):
        """Stores a run's settings for its ROS bridge; nothing is announced yet.

        Args:
            plan: Plan of the run, including the ROS bridge's.
            robot: Name of the robot application.
            recorder: Recorder of the run.
            clock: Monotonic wall clock, in seconds.
        """
        assert plan.ros is not None
        self._plan, self._ros, self._robot, self._clock = plan, plan.ros, robot, clock
        self.recorder = BridgeRecorder(recorder)
        self._wire: Wire | None = None
        self._environment: Any = None
        self._options = plan.ros.options
        self._problem: LaunchError | None = None
        self._agent: RosAgent | None = None
        self._peers = Peers()
        self._looked_at_s = -math.inf
        self._commanded_since_s: float | None = None
        self._heard_since_s: float | None = None

    def look_in(self, environment: Any) -> None:
        """Prepares the search for ROS nodes, which starts when first asked for."""
        self._environment = environment

    def _open(self) -> None:
        """Connects to the ROS nodes and announces the topics; an error is not raised but told by `missing`."""
        environment, self._environment = self._environment, None
        try:
            self._options = _options_for(environment, self._ros.options)
            _check_actions(environment, self._robot)
            wire = make_wire(self._plan, self._ros.model_copy(update={"options": self._options}))
            names = _names(self._options, self._ros.suite)
            topics = [TOPICS[topic]._replace(name=name) for topic, name in names.items()]
            wire.open(topics, command_topic(self._options))
        except LaunchError as error:
            self._problem = error
            return
        self._wire = wire
        frames = _frames(self._options)
        self.recorder.attach(wire, names, frames, () if self._options.localization == "truth" else {frames.odometry})

    def came(self) -> bool:
        """Whether ROS nodes are connected that can drive, or that wait for simulated time, and have been for a moment.

        The first call announces the topics; false if that failed, or if the last look was less than 0.1 s ago.
        """
        if self._environment is not None:
            self._open()
        if self._wire is None:
            return False
        now_s = self._clock()
        if now_s - self._looked_at_s < 0.1:
            return False
        self._looked_at_s, self._peers = now_s, self._wire.peers()
        self.recorder.note_heard(self._peers.heard, spares=False)
        self._commanded_since_s = _since(self._commanded_since_s, now_s, self._peers.commanders > 0)
        # Who publishes commands of another type would listen for ever: that is told instead.
        listens = bool(self._peers.heard) and not self._peers.mistyped
        self._heard_since_s = _since(self._heard_since_s, now_s, listens)
        if self._commanded_since_s is not None:
            return now_s - self._commanded_since_s >= _SETTLE_S
        return self._heard_since_s is not None and now_s - self._heard_since_s >= _LISTENERS_S

    def missing(self) -> str:
        """Describes which ROS nodes are missing and which are connected, or why none is reached, for an error."""
        if self._environment is not None:
            self._open()
        if self._problem is not None:
            return f"its ROS nodes are not reached: {self._problem}"
        assert self._wire is not None
        there = self._peers.not_taken
        there += [f"subscribers of {', '.join(sorted(self._peers.heard))}"] if self._peers.heard else []
        return (
            f"or a node has to publish geometry_msgs/Twist or TwistStamped on {command_topic(self._options)} in "
            f"{self._wire.name}; found there: {'; '.join(there) or 'no node'}"
        )

    def make_agent(self, environment: dm_env.Environment, stop: Any, keep: Callable[[bytes], None]) -> "RosAgent":
        """Returns the agent whose actions are the velocity commands of ROS nodes, and says so in the run's log.

        Args:
            environment: Environment in which the nodes drive.
            stop: Tells whether the run has to stop.
            keep: Called with each action that the environment gets, as bytes.
        """
        assert self._wire is not None
        sys.stdout.write(f"ROS nodes drive: {self._wire.name}, time {self._options.time}\n")
        timestep_s = float(environment.control_timestep())  # pyright: ignore[reportAttributeAccessIssue]
        timing = make_timing(self._wire, stop, self._options, timestep_s, self._clock)
        self._agent = RosAgent(
            self._wire, self.recorder, timing, self._options, self._robot, environment, keep, self._clock
        )
        return self._agent

    @property
    def options(self) -> RosOptions:
        """Options of the ROS bridge; they include the robot's `robot.yaml` once the simulation waits for nodes."""
        return self._options

    @property
    def mode(self) -> Any:
        """Mode (lock-step or free) in which the nodes' commands were received."""
        return "lockstep" if self._options.time == "lockstep" else "free"

    def close(self, ended_by: str | None = None) -> Findings:
        """Disconnects from the ROS nodes; returns findings about them for the run's result.

        The run did not end normally if the reason of its end is `None` or a `RunStop`.

        Raises:
            LaunchError: The run ended normally, but the nodes never sent a command, so nothing was tested.
        """
        agent = self._agent
        findings = agent.findings() if agent is not None else Findings()
        self.recorder.detach()
        if self._wire is not None:
            self._wire.close()
        if agent is not None and not agent.commands and ended_by not in (None, *RunStop):
            raise agent.silent()
        return findings


class RosAgent:
    """Agent whose actions are the velocity commands that ROS nodes publish."""

    def __init__(
        self,
        wire: Wire,
        recorder: BridgeRecorder,
        timing: Timing,
        options: RosOptions,
        robot: str,
        environment: Any,
        keep: Callable[[bytes], None],
        clock: Callable[[], float],
    ) -> None:
        """Creates the agent with a robot that stands still; see `RosBridge.make_agent`.

        Args:
            wire: Connection to the ROS nodes.
            recorder: Recorder that also publishes to the nodes.
            timing: Strategy by which simulated time advances.
            options: ROS options of the job.
            robot: Name of the robot application, for errors.
            environment: The environment.
            keep: Called with each action, to record it.
            clock: Monotonic clock, in seconds.
        """
        self._wire, self._recorder, self._timing, self._options = wire, recorder, timing, options
        self._robot, self._environment, self._keep, self._clock = robot, environment, keep, clock
        self._command_topic = command_topic(options)
        self._clock_topic = options.topics.get(_CLOCK, _CLOCK)
        named = robot_of(environment)
        self._has_lidar = named is not None and named.lidar is not None
        self._command = Command(STILL, STILL)
        self._commanded_at_s = -math.inf
        self._time_s = 0.0
        self._steps = self._commands = self._acted_at = 0
        self._first_command_by_s = clock() + _FIRST_COMMAND_S
        self._looked_at_s = clock()
        self._left_at_s: float | None = None
        self._peers = Peers()
        self._most_commanders = 0
        self._has_ros_nodes = False
        self._heard: frozenset[str] = frozenset()
        self._goal: tuple[float, float] | None = None
        self._visited: Any = None
        self._placed_at_s = self._told_at_s = -math.inf
        self._notes: dict[str, None] = {}

    def __call__(self, timestep: dm_env.TimeStep) -> NDArray[np.float64]:
        """Returns the action of a time step: forward velocity in m/s and turning rate in rad/s.

        Raises:
            StopIteration: All publishers of commands have left and did not come back.
            RobotProgramError: A command is not finite.
            LaunchError: No velocity command was received.
            RunStopped: The run has to stop, such as by cancellation.
        """
        time_s = self._time_s = float(self._environment.physics.data.time)
        self._steps += 1
        self._look(time_s)
        if isinstance(self._timing, Lockstep):
            self._timing.forget()
        self._publish_mission(timestep, time_s)
        published = self._recorder.publish()
        try:
            command = self._timing.next_command(time_s, scanned="/scan" in published or not self._has_lidar)
        except TimerNodeError as error:
            if not self._commands:  # advice on how to answer would mislead: none of them answers at all
                self._note_peers(self._wire.peers())
                raise self.silent() from None
            raise LaunchError(f"the nodes of robot application {self._robot}: {error}", _CRASH) from None
        if command is not None:
            self._take(command, time_s)
        elif not self._commands and self._clock() > self._first_command_by_s:
            raise self.silent()
        action = self._action(time_s)
        # Before the environment sees it, which may not survive it.
        self._keep(action.tobytes())
        return action

    @property
    def commands(self) -> int:
        """Number of velocity commands received."""
        return self._commands

    def silent(self) -> LaunchError:
        """Returns, without raising it, the error about ROS nodes that sent no commands."""
        found = [f"; one publishes {each}" for each in self._peers.not_taken]
        said = (
            f"the nodes of robot application {self._robot} sent no command on {self._command_topic} in "
            f"{self._time_s:.2f} s of simulated time"
            if self._most_commanders
            else f"no node of robot application {self._robot} publishes geometry_msgs/Twist or TwistStamped on "
            f"{self._command_topic}{''.join(found)}"
        )
        topics = ", ".join(sorted(self._heard)) or "none"
        return LaunchError(f"{said}; of the simulation's topics the nodes listen to {topics}", _UNHEALTHY)

    def findings(self) -> Findings:
        """Returns figures about the exchange with ROS nodes, and notes on its defects, for the run's result."""
        self._note_peers(self._wire.peers())  # lock-step may take all its steps between two looks
        about: dict[str, Any] = {
            "wire": self._wire.name,
            "time": self._options.time,
            "command_topic": self._command_topic,
            "commands": self._commands,
            "sent": dict(sorted(self._recorder.sent.items())),
            "heard": sorted(self._heard),
            **self._timing.figures(),
        }
        silent = self._steps - self._acted_at
        if silent >= max(20, self._steps / 2):
            self._notes[
                f"the nodes sent {counted(self._commands, 'command')} for {counted(self._steps, 'step')}, and none "
                f"after step {self._acted_at}: the robot stood still"
            ] = None
        is_deaf = self._has_ros_nodes and self._clock_topic is not None and self._clock_topic not in self._heard
        if self._commands and is_deaf:
            self._notes[
                "no node subscribed /clock: nodes that should follow simulated time need use_sim_time set to true"
            ] = None
        if self._commands and (silent := self._recorder.without_messages(self._heard)):
            self._notes[
                f"nodes subscribed {', '.join(silent)}, and the simulation published nothing there: the robot has no "
                "such sensor, or its camera could not draw"
            ] = None
        return Findings(extra={"ros": about}, notes=list(self._notes))

    def _take(self, command: Command, time_s: float) -> None:
        numbers = (*command.linear_mps, *command.angular_radps)
        if not all(map(math.isfinite, numbers)):
            shown = f"linear {command.linear_mps}, angular {command.angular_radps}"
            raise RobotProgramError(
                f"a node of robot application {self._robot} sent a command on {self._command_topic} "
                f"whose numbers are not finite: {shown}"
            )
        if command.stamp_s is not None and command.stamp_s > max(time_s + _MOST_WALL_STAMP_S, _MOST_WALL_STAMP_S):
            self._notes["commands have stamps of a wall clock: set use_sim_time to true in the nodes"] = None
        self._command, self._commanded_at_s = command, time_s
        self._commands += 1
        self._acted_at = self._steps

    def _action(self, time_s: float) -> NDArray[np.float64]:
        is_old = time_s - self._commanded_at_s >= self._options.command_timeout_s
        if is_old:
            return np.zeros(2)
        return np.array((self._command.linear_mps[0], self._command.angular_radps[2]))

    def _look(self, time_s: float) -> None:
        """Looks, now and then, which nodes are connected, and notes several commanders and wrong types for the result.

        Raises `StopIteration`, which ends the run, if all nodes that sent commands have been gone for some seconds.
        """
        now_s = self._clock()
        if now_s - self._looked_at_s < _LOOK_S and self._steps > 1:
            return
        self._looked_at_s = now_s
        self._note_peers(self._wire.peers())
        # In lock-step the first message that is heard has to be answered.
        self._recorder.note_heard(self._peers.heard, spares=not isinstance(self._timing, Lockstep))
        count = self._peers.commanders
        if count > 1:
            self._notes[f"{count} nodes publish {self._command_topic} at once: the newest command is taken"] = None
        for topic, kind in self._peers.mistyped.items():
            self._notes[
                f"a node publishes {topic} with {kind}, which is not heard: it has to be geometry_msgs/msg/Twist or "
                "TwistStamped, and reliable in lock-step"
            ] = None
        if count or not self._most_commanders:
            self._left_at_s = None
            return
        self._left_at_s = now_s if self._left_at_s is None else self._left_at_s
        if now_s - self._left_at_s >= _RETURN_S:
            self._notes[f"all publishers of {self._command_topic} had left by {time_s:.2f} s of simulated time"] = None
            raise StopIteration

    def _note_peers(self, peers: Peers) -> None:
        self._peers = peers
        self._heard |= peers.heard
        self._has_ros_nodes |= peers.has_ros_nodes
        self._most_commanders = max(self._most_commanders, peers.commanders)

    def _publish_mission(self, timestep: dm_env.TimeStep, time_s: float) -> None:
        seen = timestep.observation
        if not isinstance(seen, Mapping) or "pose" not in seen:
            return
        # The simulation has one array until another room has been visited.
        if self._commands and seen.get("visited") is self._visited:
            return
        x, y, yaw = (float(value) for value in seen["pose"])
        header = ros.Header(ros.Time.from_seconds(time_s), self._options.map_frame)
        if self._options.localization == "robot" and not self._commands and time_s - self._placed_at_s >= 1.0:
            self._placed_at_s = time_s
            turned = ros.Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))
            pose = ros.Pose(ros.Vector3(x, y), turned)
            self._recorder.write("/initialpose", ros.PoseWithCovarianceStamped(header, pose), time_s)
        self._visited = seen.get("visited")
        if self._options.goals and "goals" in seen and "visited" in seen:
            goal = _next_goal(seen["goals"], seen["visited"], (x, y), self._goal)
            # Those who drive to goals take some time to come up, and lose what is told before.
            again = not self._commands and time_s - self._told_at_s >= 1.0
            if goal is not None and (goal != self._goal or again):
                self._told_at_s = time_s
                pose = ros.Pose(ros.Vector3(*goal))
                self._recorder.write("/goal_pose", ros.PoseStamped(header, pose), time_s)
            self._goal = goal


def command_topic(options: RosOptions) -> str:
    """Returns the ROS topic of velocity commands."""
    return options.topics.get(COMMANDS) or COMMANDS


def _next_goal(
    goals: NDArray[np.float64],
    visited: Sequence[bool] | NDArray[np.bool_],
    here: tuple[float, float],
    now: tuple[float, float] | None,
) -> tuple[float, float] | None:
    """Returns the present goal until it is visited, then the nearest unvisited one; None if all are visited.

    Args:
        goals: Positions in metres, shape (goals, 2).
        visited: Whether each goal is visited.
        here: Position of the robot in metres.
        now: Present goal; None: there is none yet.

    Returns:
        Its x and y in metres.
    """
    left = [(float(x), float(y)) for (x, y), done in zip(goals, visited, strict=True) if not done]
    if now in left:
        return now
    return min(left, key=lambda goal: math.dist(goal, here), default=None)


def _since(since_s: float | None, now_s: float, holds: bool) -> float | None:
    if not holds:
        return None
    return now_s if since_s is None else since_s


def _options_for(environment: Any, given: RosOptions) -> RosOptions:
    """Merges the ROS options of the robot's `robot.yaml` with those of the launch configuration, which win.

    Raises `LaunchError` if the merged options are invalid.
    """
    robot = robot_of(environment)
    own = dict(robot.ros) if robot is not None else {}
    try:
        return RosOptions.model_validate({**own, **given.model_dump(exclude_unset=True)})
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(map(str, problem["loc"]))
        raise LaunchError(f"the robot's ros.{where}: {problem['msg']}") from None


def _check_actions(environment: Any, robot_application: str) -> None:
    """Raises `LaunchError` for an environment that cannot be driven by velocity commands: actions of two numbers."""
    robot = robot_of(environment)
    spec = environment.action_spec() if callable(getattr(environment, "action_spec", None)) else None
    shape = getattr(spec, "shape", None)
    if shape == (2,) and not (robot is not None and isinstance(robot.drive, RawDrive)):
        return
    what = f"robot {robot.name} takes commands of its actuators" if robot is not None else f"its actions are {spec}"
    raise LaunchError(
        f"ROS nodes of robot application {robot_application} send velocities, which need actions of two numbers, "
        f"forward velocity in m/s and turning rate in rad/s; {what}: give it a drive, or use the agent socket"
    )


_NAMES_IN_ROS_1 = {"/goal_pose": "/move_base_simple/goal"}
"""Topics with another name in ROS 1, where move_base subscribes goals."""


def _names(options: RosOptions, suite: Suite) -> dict[str, str]:
    """Returns the names under which topics are published to nodes, by their names in the recording."""
    others: dict[str, str | None] = {**(_NAMES_IN_ROS_1 if suite == 1 else {}), **options.topics}
    names = {topic: others.get(topic, topic) for topic in TOPICS}
    if options.localization == "robot":
        names["/map"] = None
    if not options.goals:
        names["/goal_pose"] = None
    return {topic: name for topic, name in names.items() if name is not None}


def _frames(options: RosOptions) -> Frames:
    return Frames(map=options.map_frame, odometry=options.odom_frame, base=options.base_frame, scan=options.scan_frame)
