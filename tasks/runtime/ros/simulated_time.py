"""Strategies for how simulated time advances while ROS nodes drive: paced, free, or in lock-step."""

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

from ....schemas.runs.ros_options import RosOptions
from ..episode.progress import RunStopped, Stop
from .wire import Command, Wire

Clock = Callable[[], float]

_LOOK_S = 0.05
"""Maximum seconds between two checks whether the run has to stop."""
_IDLE_AFTER_S = 1.0
"""Wall-clock seconds without a command after which paced nodes count as intentionally silent, as Nav2 at a goal."""
_WINDOW, _MOST_UNANSWERED = 20, 8
"""Number of last steps that are counted, and how many of them may lack an answer: a timer of 0.1 s skips every second
step.
"""


class TimerNodeError(Exception):
    """Raised when ROS nodes do not answer simulation steps, because they send commands by a timer."""


class Timing(Protocol):
    """Interface of a strategy for how simulated time advances with ROS nodes (free, paced, lock-step)."""

    def next_command(self, time_s: float, *, scanned: bool) -> Command | None:
        """Waits as the strategy demands, and returns the newest velocity command since the last call.

        `None` if there is none.

        Args:
            time_s: Simulated time of the step.
            scanned: Whether a scan was published with the step.

        Raises:
            RunStopped: The run has to stop, such as by cancellation.
            TimerNodeError: The nodes do not answer steps, because they send commands by a timer.
        """
        ...

    def figures(self) -> dict[str, float | int]:
        """Returns figures about waiting times for the run's result."""
        ...


class _Waits:
    """Waiting for wall-clock time or a command of ROS nodes; `RunStopped` is raised if the run has to stop."""

    def __init__(self, wire: Wire, stop: Stop, clock: Clock) -> None:
        self.wire, self._stop, self.clock = wire, stop, clock

    def until(self, due_s: float) -> Command | None:
        """Waits until a wall-clock time; returns the newest velocity command received meanwhile, `None` without one.

        Raises `RunStopped` if the run has to stop.

        Args:
            due_s: Time of `clock`, in seconds.
        """
        newest: Command | None = None
        while True:
            if commands := self.wire.take():
                newest = commands[-1]
            self.check()
            left_s = due_s - self.clock()
            if left_s <= 0:
                return newest
            if not self.wire.wait(min(left_s, _LOOK_S)):
                continue
            # Something is there: more may be on its way, and nothing is due yet.
            time.sleep(min(0.001, left_s))

    def first(self, due_s: float, is_answer: Callable[[Command], bool] = lambda _: True) -> Command | None:
        """Waits for a velocity command, and returns the first that is an answer; `None` if none came in time.

        Raises `RunStopped` if the run has to stop.

        Args:
            due_s: Time of `clock` until which to wait, in seconds.
            is_answer: Decides whether a command is the awaited one; others are dropped.
        """
        while True:
            for command in self.wire.take():
                if is_answer(command):
                    return command
            self.check()
            left_s = due_s - self.clock()
            if left_s <= 0:
                return None
            self.wire.wait(min(left_s, _LOOK_S))

    def check(self) -> None:
        if self._stop.reason:
            raise RunStopped


class Free:
    """Timing strategy: simulated time follows real time, times a factor, without waiting for ROS nodes."""

    def __init__(self, wire: Wire, stop: Stop, options: RosOptions, timestep_s: float, clock: Clock) -> None:
        self._waits = _Waits(wire, stop, clock)
        self._period_s = timestep_s / options.real_time_factor
        self._due_s: float | None = None

    def next_command(self, time_s: float, *, scanned: bool) -> Command | None:
        """Waits until real time has caught up with simulated time, and returns the newest command (see `Timing`).

        Returns `None` if none came. Raises `RunStopped` if the run has to stop.
        """
        del time_s, scanned  # the wall clock decides
        now_s = self._waits.clock()
        # Lost time is not made up for: a burst of steps after a pause would be worse.
        self._due_s = now_s + self._period_s if self._due_s is None else max(self._due_s + self._period_s, now_s)
        return self._waits.until(self._due_s)

    def figures(self) -> dict[str, float | int]:
        """Returns figures about waiting times for the run's result; see `Timing`."""
        return {}


class Paced:
    """Timing strategy: like free, but simulated time waits if it is too far ahead of the nodes' last command.

    This waits for slow nodes, as on a busy machine, but not for silent ones: after a second without a command time
    advances, until the next one arrives.
    """

    def __init__(self, wire: Wire, stop: Stop, options: RosOptions, timestep_s: float, clock: Clock) -> None:
        self._free = Free(wire, stop, options, timestep_s, clock)
        self._waits = _Waits(wire, stop, clock)
        self._ahead_s = options.ahead_s
        self._commanded_at_s: float | None = None
        """Simulated time of the newest command; None before the first one, and while nodes are silent."""
        self._waited_s = 0.0
        self._waited_for = self._silences = 0

    def next_command(self, time_s: float, *, scanned: bool) -> Command | None:
        """Returns the newest command, or `None`; waits for one if simulated time is too far ahead of the last.

        If none comes for a while, it does not wait again until the next command. See `Timing`.

        Args:
            time_s: Simulated time in seconds.
            scanned: Whether a scan was published in this step.
        """
        command = self._free.next_command(time_s, scanned=scanned)
        if command is None and self._commanded_at_s is not None and time_s - self._commanded_at_s >= self._ahead_s:
            began_s = self._waits.clock()
            command = self._waits.first(began_s + _IDLE_AFTER_S)
            self._waited_s += self._waits.clock() - began_s
            self._waited_for += 1
            if command is None:
                self._silences += 1
                self._commanded_at_s = None
        if command is not None:
            self._commanded_at_s = time_s
        return command

    def figures(self) -> dict[str, float | int]:
        """Returns figures about waiting times for the run's result; see `Timing`."""
        return {"waits": self._waited_for, "waited_s": round(self._waited_s, 3), "silences": self._silences}


class Lockstep:
    """Timing strategy: simulated time stops after each step or scan until a command answers it."""

    def __init__(self, wire: Wire, stop: Stop, options: RosOptions, clock: Clock) -> None:
        self._waits = _Waits(wire, stop, clock)
        self._timeout_s = options.answer_timeout_s
        self._each_step = options.answers == "step"
        self._answered: deque[bool] = deque(maxlen=_WINDOW)
        self._unanswered = self._steps = 0
        self._waited_s = 0.0
        self._last_s = -math.inf
        """Simulated time of the last step that had to be answered by a command."""

    def next_command(self, time_s: float, *, scanned: bool) -> Command | None:
        """Waits for the command that answers the step, and returns it; see `Timing`.

        Returns `None` if the step needs no answer, or none came in time. Raises `TimerNodeError` if too many steps stay
        without an answer.

        Args:
            time_s: Simulated time in seconds.
            scanned: Whether a scan was published in this step.
        """
        if not (scanned or self._each_step):
            return None
        began_s = self._waits.clock()
        # A command without a stamp answers if it came after the step; what came before was taken then. The clock of a
        # node may be one step behind when it stamps its answer.
        command = self._waits.first(
            began_s + self._timeout_s, lambda each: not each.stamp_s or each.stamp_s > self._last_s + 1e-6
        )
        self._last_s = time_s
        self._waited_s += self._waits.clock() - began_s
        self._steps += 1
        self._answered.append(command is not None)
        if command is None:
            self._unanswered += 1
            if self._answered.count(False) >= _MOST_UNANSWERED:
                raise TimerNodeError(self._why())
        return command

    def _why(self) -> str:
        what = "steps" if self._each_step else "scans"
        return (
            f"in lock-step {self._answered.count(False)} of the last {len(self._answered)} {what} were not answered "
            f"by a command within {self._timeout_s:g} s. Nodes that send commands by a timer, as Nav2's controller "
            'does, cannot answer each one: use "time": "paced" in ROBOMAKER_ROS'
        )

    def forget(self) -> None:
        """Drops commands received before the step that is published next."""
        self._waits.wire.take()

    def figures(self) -> dict[str, float | int]:
        """Returns figures about waiting times for the run's result; see `Timing`."""
        mean_us = round(1e6 * self._waited_s / self._steps, 1) if self._steps else 0.0
        return {"answers_awaited": self._steps, "unanswered": self._unanswered, "mean_answer_us": mean_us}


def make_timing(wire: Wire, stop: Stop, options: RosOptions, timestep_s: float, clock: Clock) -> Timing:
    """Makes the timing strategy that the ROS options ask for.

    Args:
        wire: Connection to the nodes.
        stop: Tells whether the run has to stop.
        options: Options of the ROS bridge.
        timestep_s: Simulated seconds of a step.
        clock: Monotonic wall clock, in seconds.
    """
    if options.time == "lockstep":
        return Lockstep(wire, stop, options, clock)
    kind = Paced if options.time == "paced" else Free
    return kind(wire, stop, options, timestep_s, clock)
