"""The robot application: drives to the middle of the next room, through the door between."""

import math

import numpy as np

from courier.house import PIXELS, RAYS

DOOR_X_M, GOAL_X_M = 2.5, 3.5
"""Map: the way is straight on, through the middle of the door."""
SPEED_MPS = 0.35
CONTRAST = 0.2
"""Brightness by which the opening has to stand out; less is noise of the pixels."""
BLIND_M = 0.3
"""Distance to the door below which the opening no longer fits into the picture."""
BUMPER_RAD = 0.5
"""Half of the lidar's view in which the robot slows down before what is near."""
TRUST = 0.4
"""Share of a new correction that is taken over at once."""


def opening_in_picture(picture: np.ndarray) -> float | None:
    """Finds the direction of the bright opening in a picture, in radians; None: there is none to be seen."""
    low, high = np.percentile(picture, [10, 95])
    if high - low < CONTRAST:
        return None
    bright = np.flatnonzero(picture > (low + 3 * high) / 4)
    return float(PIXELS[bright].mean())


class Courier:
    """Keeps to the line through the doorway by the wheels' odometry, which it corrects by what it sees."""

    def __init__(self) -> None:
        self._error_m = 0.0
        """Distance of the robot from the place that the odometry says, to the left."""

    def __call__(self, timestep) -> np.ndarray:
        """Returns the robot's speed in m/s and turning rate in rad/s, after the door it sees corrected its place."""
        seen = timestep.observation
        x, y, yaw = seen["odometry"]
        ahead = DOOR_X_M - x
        opening = self._opening(seen)
        if opening is not None and ahead > BLIND_M:
            # The opening is in the middle of the line: its direction says how far the robot is beside that.
            self._error_m += TRUST * (-ahead * math.tan(opening + yaw) - y - self._error_m)
        heading = np.clip(-2.5 * (y + self._error_m), -0.6, 0.6)
        free_m = seen["scan"][np.abs(RAYS) < BUMPER_RAD].min()
        speed = min(SPEED_MPS, free_m - 0.25) if x < GOAL_X_M else 0.0
        return np.array([speed, np.clip(3 * (heading - yaw), -1.5, 1.5)])

    def _opening(self, seen) -> float | None:
        return opening_in_picture(seen["picture"])


def make_agent(context, environment) -> Courier:
    """Makes the robot's program."""
    return Courier()
