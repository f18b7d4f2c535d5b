"""Names of the ROS frames of a recording; apart from recorders, since a `robot.yaml` is read without those."""

from typing import NamedTuple


class Frames(NamedTuple):
    """Names of the ROS frames that the built-in simulation publishes."""

    map: str = "map"
    odometry: str = "odom"
    base: str = "base_link"
    scan: str = "base_scan"
    footprint: str = "base_footprint"
    """Frame below the base on the floor, which AMCL needs; not published if the base itself has this name."""

    imu: str = "imu_link"


DEFAULT_FRAMES = Frames()
