"""Drift of the odometry: the pose that the robot is told wanders off, the farther it drives."""

from typing import Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter


class OdometryDriftAxis(NumberAxis):
    """Standard deviation of the error of the robot's pose after one metre; it grows with the root of the distance."""

    varies = (
        "standard deviation of the error that `pose` has after the first metre, of x and y in m and of the heading in "
        "rad; a random walk, which grows with the root of the distance"
    )
    applies_to = "`indoor-navigation`, and environments that have `odometry_errors`"
    unit = "m"
    # Half a metre after one metre: beyond that a pose says nothing of the place.
    least, most = 0.0, 0.5
    neutral = "0"

    kind: Literal["odometry_drift_std_m"] = Field(description="`odometry_drift_std_m`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that sets the drift of the robot's odometry; `None` is as built."""
        odometry = rig.odometry
        built = odometry.drift_std_m

        def set_drift(drift_std_m: float | None) -> None:
            odometry.drift_std_m = built if drift_std_m is None else drift_std_m

        return set_drift
