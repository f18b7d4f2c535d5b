"""Axis for the noise of the lidar, as a multiple of the robot's default noise."""

from typing import Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter


class LidarNoiseFactorAxis(NumberAxis):
    """Factor on the standard deviation of the noise of the lidar's ranges."""

    varies = "standard deviation of the lidar's ranges, in multiples of the robot's own"
    applies_to = "`indoor-navigation` with a robot that has a lidar, and environments that have `lidar_errors`"
    unit = "factor"
    # A hundred times the noise of usual lidars, 5 to 20 mm, is as much as `lidar_noise_std_m` allows.
    least, most = 0.0, 100.0
    neutral = "1"
    subject = "noise of the lidar"

    kind: Literal["lidar_noise_factor"] = Field(description="`lidar_noise_factor`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that scales the noise of the robot's lidar; `None` is as built."""
        lidar = rig.lidar
        built = lidar.noise_std_m

        def set_factor(factor: float | None) -> None:
            lidar.noise_std_m = built if factor is None else built * factor

        return set_factor
