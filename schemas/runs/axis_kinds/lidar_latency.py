"""Axis for the latency of lidar scans."""

from typing import Literal

from pydantic import Field

from .kind import LidarAxis


class LidarLatencyAxis(LidarAxis):
    """Time in seconds from a scan to the observation that contains it; it is rounded up to the control step."""

    varies = "time from a scan to the observation that has it, rounded up to the control step of 50 ms"
    error = "latency_s"
    unit = "s"
    # Scans that are older are another room's.
    least, most = 0.0, 2.0
    neutral = "0"

    kind: Literal["lidar_latency_s"] = Field(description="`lidar_latency_s`.")
