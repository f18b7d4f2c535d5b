"""Inertial measurement units."""

from collections.abc import Mapping
from typing import ClassVar

from .....schemas.wire.base import optional
from ...recording.cdr import imu
from .kind import PartName, SensorKind


class Imu(SensorKind):
    """IMU sensor of a robot (gyroscope and accelerometer): existing or added to a body."""

    name = "imu"
    parts: ClassVar[Mapping[str, str]] = {"gyro": "GYRO", "accelerometer": "ACCELEROMETER"}
    units = "gyro rad/s, accelerometer m/s^2"
    topic = "/imu"
    columns = imu

    at: PartName | None = optional("Site or body (link) that gets a gyro and an accelerometer.")
    gyro: PartName | None = optional("Name of the model's gyro instead.")
    accelerometer: PartName | None = optional("Name of the model's accelerometer instead.")
