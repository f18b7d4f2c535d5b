"""Simulation application `recorded-run`: replays a ROS recording so that requirements can judge it.

The recording is the job's data source. Nothing is simulated: the physics has only a body that moves as the recorded
robot did, for requirements that read positions.
"""

# dm_control and dm_env have no types, so overriding their methods looks wrong to a type checker.
# pyright: reportIncompatibleMethodOverride=false, reportAttributeAccessIssue=false

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dm_env
import mujoco
import numpy as np
from dm_control.mujoco import Physics
from dm_env import specs

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.recording_sources import RECORDED_RUN, RecordingSources, sources_in
from ....schemas.runs.requirement_kinds.kind import NotMeasuredError
from ....schemas.wire.errors import InvalidParameterException, LaunchError
from ....schemas.worlds.world import World
from ..episode.context import SimulationContext
from ..episode.run_results import MAX_PATH_POINTS, EnvironmentReport
from ..judging.bags import Bag, Message, RecordingFault, find_recording
from ..judging.topic_scene import CLOCK, Measurements, TopicScene
from .falling_ball import make_agent as make_agent  # it does nothing, as the robot has driven already

_STEP_S = 0.01
"""Period of a step in seconds; messages within it belong to one step. Collisions, the most frequent requirement, have
this period.
"""
_PATH_EVERY_S = 0.1
_RADIUS_M = 0.25
"""Radius in metres of the body that replaces the robot if none is given; a larger jump of the position is reported."""
_MODEL = """
<mujoco model="recorded run">
  <worldbody>
    <body name="robot"><freejoint/><geom size="{radius_m}" contype="0" conaffinity="0"/></body>
  </worldbody>
</mujoco>
"""


class RecordedRun(dm_env.Environment):
    """Environment that replays a ROS recording, so that requirements can judge the recorded run."""

    robot_body = "robot"

    def __init__(
        self,
        path: Path,
        sources: RecordingSources,
        losses: Mapping[str, str] | None = None,
        *,
        calls_functions: bool = True,
    ) -> None:
        """Opens the ROS recording that is to be replayed and judged.

        Args:
            path: The recording's file; see `find_recording`.
            sources: Topics by which the recording is judged.
            losses: Reasons why topics are not recorded completely, by topic; `None`: no losses are known.
            calls_functions: Whether requirements may call functions of applications.

        Raises:
            RecordingFault: The recording cannot be read, or lacks a topic that is named.
        """
        self._sources, self._calls_functions = sources, calls_functions
        self._bag = Bag(path)
        try:
            self._clock = self._find_clock()
            self._measurements = Measurements(self._bag, sources, losses or {})
        except BaseException:
            self._bag.close()
            raise
        self._physics = Physics.from_xml_string(_MODEL.format(radius_m=sources.radius_m or _RADIUS_M))
        self._messages: Iterator[Message] = iter(())
        self._next: Message | None = None
        self._next_s = self._clock_s = self._time_s = 0.0
        self._path: list[tuple[float, float, float]] = []
        self._heard: dict[str, int] = {}
        self._held: list[tuple[Message, float]] = []
        """Contacts and scans of the first moment, held back because requirements are first checked after it."""

    @property
    def physics(self) -> Physics:
        """Physics with the body that replaces the robot, and the recording's time."""
        return self._physics

    def requirements_scene(self, plan: RunPlan, read_world: Callable[[], World | None]) -> TopicScene:
        """Returns the scene (recorded topics) in which requirements are measured.

        `read_world` returns the world that the robot was in, or `None`; it is called when first needed.
        """
        return TopicScene(self, self._measurements, plan, read_world, calls_functions=self._calls_functions)

    def messages_on(self, topic: str) -> Iterator[tuple[float, Any]]:
        """Returns the messages on a topic during the run, each with its time in seconds since the run began.

        Raises:
            NotMeasuredError: The recording has no such topic.
        """
        if topic not in self._bag.types:
            raise NotMeasuredError(f"{self._bag.path.name} has no topic {topic}{self._bag.near(topic)}")
        return ((time_s, message.content) for time_s, message in self.timed(topic))

    def timed(self, topic: str) -> Iterator[tuple[float, Message]]:
        """Yields the messages on an existing topic, from the run's beginning on, each with its time in seconds."""
        clock_s = 0.0
        for message in self._bag.messages({topic, *([CLOCK] if self._clock else [])}):
            if self._clock and message.topic == CLOCK:
                clock_s = message.content.clock.sec + message.content.clock.nanosec / 1e9
            time_s = clock_s - self._sources.start_s if self._clock else self._received_s(message.time_ns)
            if message.topic == topic and time_s >= 0:
                yield time_s, message

    def reset(self) -> dm_env.TimeStep:
        """Goes to the beginning of the recorded run, and returns the first time step.

        Raises:
            RecordingFault: The recording is damaged, or ends before the run begins.
        """
        with self._closed_by_faults():
            return self._reset()

    def _reset(self) -> dm_env.TimeStep:
        topics = {*self._measurements.topics, *([CLOCK] if self._clock else [])}
        self._messages = self._bag.messages(topics)
        self._clock_s, self._path, self._heard, self._held = 0.0, [], {}, []
        self._physics.reset()
        self._advance()
        self._take_until(0.0, holds=True)
        if self._next is None and self.end_s <= 0:
            self.close()
            raise RecordingFault(
                f"{self._bag.path} ends before start_s ({self._sources.start_s:g} s), so there is no run in it"
            )
        self._show(0.0)
        return dm_env.restart(self._time())

    def step(self, action: Any) -> dm_env.TimeStep:  # noqa: ARG002 - what happened has happened
        """Reads the recording's messages up to the end of the next step, and returns its time step.

        Raises:
            RecordingFault: The recording is damaged, or its time goes backwards.
        """
        with self._closed_by_faults():
            return self._step()

    def _step(self) -> dm_env.TimeStep:
        for message, time_s in self._held:
            self._measurements.take(message, time_s)
        self._held.clear()
        if self._next is None:
            end_s = max(self._time_s, self.end_s)
            self._measurements.look_back(end_s)
            self._show(end_s)
            return dm_env.termination(0.0, self._time())
        first_s = max(self._next_s, self._time_s)
        last_s = self._take_until(first_s + _STEP_S)
        self._measurements.look_back(last_s)
        self._show(last_s)
        return dm_env.transition(0.0, self._time())

    def observation_spec(self) -> specs.Array:
        """Returns the observation's spec: the time in seconds, shape (1,)."""
        return specs.Array((1,), float)

    def action_spec(self) -> specs.Array:
        """Returns the action's spec: no actions, shape (0,)."""
        return specs.Array((0,), float)

    def run_result(self) -> EnvironmentReport:
        """Returns the driven path, and the topics and method that measured it; the job's requirements judge the run.

        Ends the measurement, which checks what the recording did not have.
        """
        self._measurements.finish(self._time_s, is_over=self._next is not None)
        seconds = f"{self._time_s:.1f} s"
        about = {"file": self._bag.path.name, "topics": self._heard, "time": "clock" if self._clock else "received"}
        return EnvironmentReport(
            summary=f"Judged from the recording {self._bag.path.name}, {seconds}.",
            notes=self._measurements.remarks(),
            path=self._path[:: math.ceil(len(self._path) / MAX_PATH_POINTS) or 1],
            extra={"recording": about},
        )

    def close(self) -> None:
        """Closes the recording that this environment replays."""
        self._bag.close()

    @contextmanager
    def _closed_by_faults(self) -> Iterator[None]:
        """Closes the recording if reading it fails inside the `with` block, since nothing else would close it.

        The `RecordingFault` is raised again.
        """
        try:
            yield
        except RecordingFault:
            self.close()
            raise

    @property
    def end_s(self) -> float:
        """Time of the recording's last message, in seconds since the run began."""
        return self._clock_s - self._sources.start_s if self._clock else self._received_s(self._bag.end_ns)

    def _find_clock(self) -> bool:
        """Returns whether the time is that of the topic `/clock`.

        Raises:
            RecordingFault: The time has to be that of `/clock`, and the recording lacks the topic.
        """
        if self._sources.time != "received" and (why := self._bag.mixed(CLOCK)) is not None:
            raise RecordingFault(f"{self._bag.path}: {why}; time: received would do as well")
        has_clock = bool(self._bag.counts.get(CLOCK))
        if self._sources.time == "clock" and not has_clock:
            raise RecordingFault(
                f"{self._bag.path}: time is clock, but there is no message on {CLOCK}; received would do"
            )
        return has_clock and self._sources.time != "received"

    def _advance(self) -> None:
        """Reads one message of the recording ahead, and determines its time in the run, in seconds.

        Clock messages are used up. Raises `RecordingFault` if time goes backwards on the clock's topic.
        """
        message = self._next = next(self._messages, None)
        while message is not None and self._clock and message.topic == CLOCK:
            stamp = message.content.clock
            time_s = stamp.sec + stamp.nanosec / 1e9
            if time_s < self._clock_s:
                raise RecordingFault(
                    f"{self._bag.path}: time goes backwards on {CLOCK}, from {self._clock_s:.3f} to {time_s:.3f} s; "
                    "record each run in a recording of its own"
                )
            self._clock_s = time_s
            message = self._next = next(self._messages, None)
        if message is not None:
            self._next_s = self._clock_s - self._sources.start_s if self._clock else self._received_s(message.time_ns)

    def _received_s(self, time_ns: int) -> float:
        return (time_ns - self._bag.start_ns) / 1e9 - self._sources.start_s

    def _take_until(self, until_s: float, *, holds: bool = False) -> float:
        """Takes the recording's messages up to a time; returns the time of the latest one, or the present time.

        Args:
            until_s: Time in the run, in seconds.
            holds: Whether messages without poses are held back, to be taken later.
        """
        last_s = self._time_s
        while self._next is not None and self._next_s <= until_s:
            message, time_s = self._next, self._next_s
            if not holds or self._measurements.is_pose(message.topic):
                self._measurements.take(message, time_s)
            elif time_s >= 0:
                self._held.append((message, time_s))
            self._heard[message.topic] = self._heard.get(message.topic, 0) + 1
            last_s = max(last_s, time_s)
            self._advance()
        return last_s

    def _show(self, time_s: float) -> None:
        """Sets the physics' time in seconds, moves the body to the recorded pose, and adds that to the driven path.

        If no pose is known yet, only the time is set.
        """
        self._time_s = self._physics.data.time = max(0.0, time_s)
        pose = self._measurements.pose
        if pose is None or not math.isfinite(pose.position[0]):
            return
        self._physics.data.qpos[:] = (*pose.position, *pose.orientation)
        mujoco.mj_kinematics(self._physics.model.ptr, self._physics.data.ptr)
        if not self._path or self._time_s - self._path[-1][0] >= _PATH_EVERY_S:
            self._path.append((self._time_s, pose.position[0], pose.position[1]))

    def _time(self) -> np.ndarray:
        return np.array([self._time_s])


def make_environment(context: SimulationContext) -> RecordedRun:
    """Makes the environment that replays the recording among the job's data sources.

    Raises:
        LaunchError: The job has no recording among its data sources, or the recording cannot be judged.
    """
    if context.data_dir is None:
        raise LaunchError(
            f"{RECORDED_RUN} judges a recording, and the job has no data source; dataSources: [{{name: recording, "
            "s3Bucket: ..., s3Keys: [...]}] would be right"
        )
    try:
        sources = sources_in(context.environment)
    except InvalidParameterException as error:
        raise LaunchError(str(error)) from error
    return RecordedRun(find_recording(context.data_dir), sources)
