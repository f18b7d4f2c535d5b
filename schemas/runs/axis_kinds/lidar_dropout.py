"""Axis for the share of lidar rays that return nothing."""

from typing import Literal

from pydantic import Field

from .kind import LidarAxis


class LidarDropoutAxis(LidarAxis):
    """Probability that a ray of the lidar returns nothing, independently in every scan."""

    varies = "share of the lidar's rays that see nothing, other ones in every scan"
    error = "dropout"
    unit = "share"
    # At 1 the robot is blind.
    least, most = 0.0, 1.0
    neutral = "0"

    kind: Literal["lidar_dropout"] = Field(description="`lidar_dropout`.")
