"""Axis that adds a constant length to all ranges of the lidar."""

from typing import Literal

from pydantic import Field

from .kind import LidarAxis


class LidarBiasAxis(LidarAxis):
    """Length in metres that is added to all ranges that the lidar measures."""

    varies = "length that all of the lidar's ranges are too long by"
    error = "bias_m"
    unit = "m"
    # Rooms are a few metres wide: nothing is where it seems with more.
    least, most = -1.0, 1.0
    neutral = "0"

    kind: Literal["lidar_bias_m"] = Field(description="`lidar_bias_m`.")
