"""Inertial measurement units."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from .....schemas.wire.base import optional
from .kind import PartName, SensorKind

if TYPE_CHECKING:
    from ...recording.cdr import Columns


def _columns(frame: str) -> "Columns":
    from ...recording.cdr import imu  # it brings numpy and the types of ROS

    return imu(frame)


class Imu(SensorKind):
    """IMU sensor of a robot (gyroscope and accelerometer): existing or added to a body."""

    name = "imu"
    parts: ClassVar[Mapping[str, str]] = {"gyro": "GYRO", "accelerometer": "ACCELEROMETER"}
    units = "gyro rad/s, accelerometer m/s^2"
    topic = "/imu"
    columns = _columns

    at: PartName | None = optional("Site or body (link) that gets a gyro and an accelerometer.")
    gyro: PartName | None = optional("Name of the model's gyro instead.")
    accelerometer: PartName | None = optional("Name of the model's accelerometer instead.")
