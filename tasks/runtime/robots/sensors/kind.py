"""Parts of a kind of sensor."""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field

from .....schemas.wire.base import Model, optional
from ...recording.cdr import Columns
from ...recording.messages import Header
from ...recording.recording import Frames

OBSERVED = frozenset(
    [
        "time",
        "pose",
        "velocity",
        "goals",
        "visited",
        "wheel_velocity",
        "joint_position",
        "joint_velocity",
        "scan",
        "proximity",
        "scan_time",
    ]
)
"""Names of what robots of the built-in simulation observe besides these sensors."""
PUBLISHED = frozenset(
    [
        "/clock",
        "/tf",
        "/tf_static",
        "/odom",
        "/joint_states",
        "/scan",
        "/contacts",
        "/goals",
        "/map",
        "/world",
        "/robot",
        "/robot_description",
        "/goal_pose",
        "/plan",
        "/camera/image_raw/compressed",
        "/camera/camera_info",
    ]
)
"""Topics of its recordings besides those of these sensors."""
FRAMES = frozenset(Frames._fields) - {"imu"}
"""Names of frames that are no sensor's."""

PartName = Annotated[str, Field(min_length=1, max_length=200)]


class SensorKind(Model):
    """Base class of sensor kinds, which `robot.yaml` can have below `sensors`.

    A kind is a subclass with a name. For each of `parts` it has a member that may be absent.
    """

    name: ClassVar[str]
    """Its name in `robot.yaml` and in observations, `imu`."""
    parts: ClassVar[Mapping[str, str]]
    """MuJoCo's types of sensors by member, `{"gyro": "GYRO"}`: their numbers, one after the other, are the reading."""
    units: ClassVar[str]
    """The numbers of a reading in words, for the specs of observations."""
    topic: ClassVar[str] = ""
    """Topic of its messages in recordings; empty: there is none."""

    columns: ClassVar[Callable[[str], Columns] | None] = None
    """Columns of its messages by frame, which are encoded many at once: attitude x, y, z, w, then a reading."""

    at: PartName | None = optional("Site or body (link) that gets a new one.")

    @property
    def own_names(self) -> tuple[str, ...]:
        """Names of the MuJoCo sensors that this kind adds to the model."""
        return tuple(f"{self.name}_{part}" for part in self.parts)

    @classmethod
    def message(cls, header: Header, numbers: Sequence[float]) -> Any:
        """Makes the ROS message of a reading.

        Args:
            header: Simulated time, and a frame that is where the sensor is.
            numbers: The reading.
        """
        raise NotImplementedError


class Sensor(NamedTuple):
    """A sensor of a robot."""

    kind: type[SensorKind]
    names: Sequence[str]
    """Names of MuJoCo's sensors, one for each part."""
