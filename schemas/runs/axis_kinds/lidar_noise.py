"""Axis for the noise of the lidar's ranges."""

from typing import Literal

from pydantic import Field

from .kind import LidarAxis


class LidarNoiseAxis(LidarAxis):
    """Standard deviation in metres of the noise of the lidar's ranges."""

    varies = "standard deviation of the lidar's ranges"
    error = "noise_std_m"
    unit = "m"
    # A lidar whose ranges scatter by more than a metre sees no home.
    least, most = 0.0, 1.0
    neutral = "the robot's own, 0.005 for Scout"
    subject = "noise of the lidar"

    kind: Literal["lidar_noise_std_m"] = Field(description="`lidar_noise_std_m`.")
