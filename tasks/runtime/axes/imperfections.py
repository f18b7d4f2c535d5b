"""Imperfections of a robot that are no part of its model: of its lidar, its commands, its wheels and its odometry.

An environment that has them as `lidar_errors`, `command_delay`, `command_gains`, `wheel_slip` and `odometry_errors`
lets axes of trials change them. They count from the next `reset` on.
"""

import math
from collections import deque
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..episode.context import KeepsAttributes

SUBSTEP_S = 0.01
"""Simulated seconds between two updates of delayed commands."""
_ROUNDING = 1e-9
"""Tolerance for rounding errors in sums and quotients of times."""


@dataclass
class LidarErrors:
    """Errors of a lidar, which axes of trials can change: noise and bias (m), share of lost rays, and latency (s)."""

    noise_std_m: float
    """Standard deviation of the noise of ranges, in metres."""
    bias_m: float = 0.0
    """Error that is added to all ranges, in metres."""
    dropout: float = 0.0
    """Probability that a ray measures nothing, 0 to 1."""
    latency_s: float = 0.0
    """Simulated seconds from a scan to the first observation that can contain it."""

    def disturb(
        self, ranges: NDArray[np.float64], rng: np.random.Generator, chance: np.random.Generator
    ) -> NDArray[np.float64]:
        """Returns ranges with noise, bias and dropout.

        Args:
            ranges: The true ranges in metres, infinite where there is nothing.
            rng: Random generator of the noise.
            chance: Random generator of the dropout; separate, so that the noise is the same with and without dropout.
        """
        measured = ranges + rng.normal(self.bias_m, self.noise_std_m, ranges.shape)
        if self.dropout > 0:
            measured[chance.random(ranges.shape) < self.dropout] = np.inf
        return measured


@dataclass
class CommandDelay:
    """Delay in seconds between an agent's commands and the motors, which axes of trials can change."""

    delay_s: float = 0.0
    """Simulated seconds from a command to the motors."""


@dataclass
class CommandGains:
    """Factors on an agent's commands, which axes of trials can change: one on all numbers, one on the turning rate."""

    whole: float = 1.0
    """Factor on all numbers of a command."""
    turn: float | None = 1.0
    """Additional factor on the turning rate, the second of a command's two numbers; None: commands have no turning
    rate.
    """

    @property
    def change_nothing(self) -> bool:
        """Whether all factors are 1, so that commands stay as they are."""
        return self.whole == 1 and self.turn in (1, None)

    def scale(self, action: Any) -> Any:
        """Returns a robot command multiplied by the factors: one for all numbers, another for the turning of two.

        A command that is not numeric is returned unchanged.
        """
        try:
            values = np.array(action, np.float64)
        except (TypeError, ValueError):
            return action
        values *= self.whole
        if self.turn is not None and values.shape == (2,):
            values[1] *= self.turn
        return values


@dataclass
class WheelSlip:
    """Share of the wheels' motion that is lost to the floor, from 0 to 1, which axes of trials can change."""

    slip: float = 0.0
    """Share of their turning that does not move the robot, 0 to below 1."""

    @property
    def transmitted(self) -> float:
        """Share of the wheels' motion that moves the robot, from 0 to 1; the rest is lost to the floor."""
        return 1.0 - self.slip


@dataclass
class OdometryErrors:
    """Errors of the pose that a robot is told, which axes of trials can change: drift in metres per root of a metre."""

    drift_std_m: float = 0.0
    """Standard deviation of x and y in metres, and of the heading in radians, after one metre of way."""


class OdometryDrift(KeepsAttributes):
    """Random walk of the error of a pose: it grows with the way that was driven, and not while the robot stands."""

    KEPT = ("_error", "_last")

    def __init__(self, errors: OdometryErrors, chance: np.random.Generator) -> None:
        """Prepares the drift of a robot's odometry, which begins without an error.

        Args:
            errors: The errors, as they are now.
            chance: Source of the steps.
        """
        self._std = errors.drift_std_m
        self._chance = chance
        self._error = (0.0, 0.0, 0.0)
        self._last: tuple[float, float] | None = None

    def told(self, x: float, y: float, yaw: float) -> tuple[float, float, float]:
        """Returns the erroneous pose that odometry reports for a true pose; to be called at each control step.

        The error grows at random with each metre driven. Positions are in metres, `yaw` is in radians.
        """
        if self._std == 0.0:
            return x, y, yaw
        last, self._last = self._last or (x, y), (x, y)
        way_m = math.hypot(x - last[0], y - last[1])
        if way_m > 0.0:
            steps = self._chance.normal(0.0, self._std * math.sqrt(way_m), 3).tolist()
            self._error = (self._error[0] + steps[0], self._error[1] + steps[1], self._error[2] + steps[2])
        wrong = self._error
        return x + wrong[0], y + wrong[1], math.remainder(yaw + wrong[2], math.tau)

    def state(self) -> Any:
        """Returns the present odometry error and the random generator's state, for a checkpoint."""
        return super().state(), self._chance.bit_generator.state

    def restore(self, state: Any) -> None:
        """Restores the odometry error and the random generator's state from a checkpoint."""
        own, self._chance.bit_generator.state = state
        super().restore(own)


_Item = TypeVar("_Item")


class LateItems(KeepsAttributes, Generic[_Item]):
    """Queue of items that become available at a later time, in order."""

    KEPT = ("waiting",)

    def __init__(self) -> None:
        self.waiting: deque[tuple[float, _Item]] = deque()
        """Waiting items, each with the time in seconds at which it is due."""

    def add(self, due_s: float, item: _Item) -> None:
        """Adds an item to the queue, with the time from which it is available."""
        self.waiting.append((due_s, item))

    def take(self, now_s: float) -> _Item | None:
        """Removes all items that are due, and returns the last of them; `None`: none is due."""
        last = None
        while self.waiting and self.waiting[0][0] <= now_s + _ROUNDING:
            last = self.waiting.popleft()[1]
        return last


class _Controller(Protocol):
    """Interface of a robot's controller, as far as scaled and delayed commands need it; see `robots/robot.py`."""

    substep: Callable[[], None] | None

    def reset(self) -> None: ...
    def state(self) -> Any: ...
    def restore(self, state: Any) -> None: ...
    def command(self, action: Any) -> bool: ...


class ScaledController:
    """Controller that multiplies commands by factors and passes them to another controller."""

    def __init__(self, controller: _Controller, gains: CommandGains) -> None:
        """Creates a controller that multiplies commands by the present factors.

        Args:
            controller: Controller that executes the commands.
            gains: The factors.
        """
        self._controller = controller
        self._gains = copy(gains)
        self.substep = controller.substep
        self.reset = controller.reset
        self.state = controller.state
        self.restore = controller.restore

    def command(self, action: Any) -> bool:
        """Passes a command on, and returns whether it tells the robot to stand still.

        Raises:
            ActionError: The command is no action of this robot.
        """
        return self._controller.command(self._gains.scale(action))


class DelayedController(KeepsAttributes):
    """Controller that passes commands to another controller after a delay, in steps of 10 ms."""

    KEPT = ("_waiting", "_standing")

    substep: Callable[[], None] | None

    def __init__(self, controller: _Controller, delay_s: float) -> None:
        """Creates a controller that delays commands, of which none wait yet.

        Args:
            controller: Controller that executes the commands.
            delay_s: Simulated seconds from a command to its execution; rounded up to 10 ms.
        """
        self._controller = controller
        self._substeps = math.ceil(delay_s / SUBSTEP_S - _ROUNDING)
        self.substep = self._substep
        self.reset()

    def reset(self) -> None:
        """Drops all waiting commands, so that the robot stands still."""
        self._waiting: list[tuple[int, Any]] = []
        """Waiting commands, each with the number of substeps that it still waits."""
        self._standing = True
        self._controller.reset()

    def command(self, action: Any) -> bool:
        """Queues a command, and returns whether the last executed command tells the robot to stand still.

        Raises:
            ActionError: A command that is executed now is no action of this robot.
        """
        self._waiting.append((self._substeps, copy(action)))  # agents may write to the array that they gave
        self._carry_out()
        return self._standing

    def state(self) -> Any:
        """Returns the waiting commands and the other controller's state, for a checkpoint."""
        return super().state(), self._controller.state()

    def restore(self, state: Any) -> None:
        """Restores the waiting commands and the other controller's state from a checkpoint."""
        own, of_controller = state
        super().restore(own)
        self._controller.restore(of_controller)

    def _substep(self) -> None:
        # First, as legs follow a command only from their next substep on.
        if self._controller.substep is not None:
            self._controller.substep()
        self._waiting = [(substeps - 1, action) for substeps, action in self._waiting]
        self._carry_out()

    def _carry_out(self) -> None:
        while self._waiting and self._waiting[0][0] <= 0:
            self._standing = self._controller.command(self._waiting.pop(0)[1])
