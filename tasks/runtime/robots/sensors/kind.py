"""Base class of the kinds of sensors."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

from pydantic import Field

from .....schemas.wire.base import Model, optional
from ...recording.frames import Frames

if TYPE_CHECKING:  # they bring numpy and the types of ROS, which take longer than to read a robot.yaml
    from ...recording.cdr import Columns
    from ...recording.messages import Header

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
"""Names of the built-in simulation's observations besides those of these sensors."""
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
"""Topics of the built-in simulation's recordings besides those of these sensors."""
FRAMES = frozenset(Frames._fields) - {"imu"}
"""Names of frames that do not belong to a sensor."""

PartName = Annotated[str, Field(min_length=1, max_length=200)]


class SensorKind(Model):
    """Base class of the kinds of sensors that `robot.yaml` can have in `sensors`.

    A kind is a subclass with a name. It has an optional member for each of `parts`.
    """

    name: ClassVar[str]
    """Name of the kind in `robot.yaml` and in observations, such as `imu`."""
    parts: ClassVar[Mapping[str, str]]
    """MuJoCo sensor type of each member, `{"gyro": "GYRO"}`; their numbers, one after the other, are a reading."""
    units: ClassVar[str]
    """Description of a reading's numbers with their units, for the specs of observations."""
    topic: ClassVar[str] = ""
    """ROS topic of the sensor's messages in recordings; empty: there is none."""

    columns: ClassVar["Callable[[str], Columns] | None"] = None
    """Function that makes the message template of a frame; its numbers are an attitude x, y, z, w, then a reading."""

    at: PartName | None = optional("Site or body (link) that gets a new one.")

    @property
    def own_names(self) -> tuple[str, ...]:
        """Names of the MuJoCo sensors that this kind adds to the model."""
        return tuple(f"{self.name}_{part}" for part in self.parts)

    @classmethod
    def message(cls, header: "Header", numbers: Sequence[float]) -> Any:
        """Returns the ROS message of a reading; to be overridden by kinds of sensors with a topic.

        Args:
            header: Simulated time, and frame of the sensor.
            numbers: Numbers of the reading.

        Raises NotImplementedError where no kind overrides it.
        """
        raise NotImplementedError


class Sensor(NamedTuple):
    """A sensor of a robot, as MuJoCo sensors whose numbers form its reading."""

    kind: type[SensorKind]
    names: Sequence[str]
    """Names of the MuJoCo sensors, one for each member."""
