"""Noise of the lidar: its ranges scatter around the true ones."""

from typing import Literal

from pydantic import Field

from .kind import LidarAxis


class LidarNoiseAxis(LidarAxis):
    """Standard deviation in metres of the ranges that the lidar measures."""

    varies = "standard deviation of the lidar's ranges"
    error = "noise_std_m"
    unit = "m"
    # A lidar whose ranges scatter by more than a metre sees no home.
    least, most = 0.0, 1.0
    neutral = "the robot's own, 0.005 for Scout"
    subject = "noise of the lidar"

    kind: Literal["lidar_noise_std_m"] = Field(description="`lidar_noise_std_m`.")
