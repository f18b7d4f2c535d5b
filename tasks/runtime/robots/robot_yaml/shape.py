"""Schema of `robot.yaml`: properties of a robot that a simulation needs and its MJCF, URDF or SDF does not have.

The schema depends on `drive.kind`, so that an error is reported once and about the right members.
"""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import Field, create_model

from .....schemas.discovery import classes_of
from .....schemas.runs.ros_options import RosOptions
from .....schemas.wire.base import Model, optional
from .....schemas.wire.errors import ConfigurationError
from .....schemas.wire.json_values import is_object
from .. import sensors
from ..sensors.kind import FRAMES, OBSERVED, PUBLISHED, PartName, SensorKind

Gain = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Metres = Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)]
Length = Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]


class RobotFootprint(Model):
    """Footprint of a robot on the floor, in `robot.yaml`."""

    radius_m: Length = Field(
        description="Radius of the disc around the base's origin that holds all of the robot; metres."
    )


class RobotSpawn(Model):
    """Initial pose of a robot, in `robot.yaml`."""

    height_m: Metres = Field(description="Height of the base's origin over the floor; metres.")
    joints: dict[str, float] = Field(
        default={},
        description="Positions of joints by name, radians or metres; others are at 0, or as in the keyframe.",
    )
    keyframe: PartName | None = optional("Name of a keyframe of the MJCF whose joint positions are taken.")


class AddedActuator(Model):
    """Actuator that `robot.yaml` adds to a model, such as one from URDF."""

    joint: PartName = Field(description="Joint that it moves.")
    kind: Literal["velocity", "position", "motor"] = Field(
        description="Kind of control signal: `velocity` rad/s or m/s, `position` rad or m, `motor` N·m or N."
    )
    name: PartName | None = optional("Its name; absent: the joint's.")
    gain: Gain = Field(
        default=1.0,
        description="Torque per error: N·m·s/rad (velocity), N·m/rad (position), or N·m per unit of control (motor).",
    )
    damping: Annotated[float, Field(ge=0, allow_inf_nan=False)] = Field(
        default=0.0, description="N·m·s/rad, of a position actuator."
    )
    force_limit: Gain | None = optional("Largest torque or force, N·m or N; absent: no limit.")
    range: Annotated[list[float], Field(min_length=2, max_length=2)] | None = optional(
        "Smallest and largest control; absent: no limit."
    )
    armature: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = optional(
        "Inertia of the motor's rotor as the joint feels it, kg·m²; absent: as in the model."
    )


class DriveLimits(Model):
    """Velocity and acceleration limits of a robot's drive, in `robot.yaml`."""

    max_linear_mps: Annotated[float, Field(gt=0, le=20, allow_inf_nan=False)] = Field(
        description="Largest forward velocity, m/s."
    )
    max_angular_radps: Annotated[float, Field(gt=0, le=50, allow_inf_nan=False)] = Field(
        description="Largest turning rate, rad/s."
    )
    max_linear_mps2: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)] = Field(
        default=1.2, description="Largest change of the forward velocity, m/s²."
    )
    max_angular_radps2: Annotated[float, Field(gt=0, le=500, allow_inf_nan=False)] = Field(
        default=8.0, description="Largest change of the turning rate, rad/s²."
    )


class DifferentialDriveModel(DriveLimits):
    """Differential drive in `robot.yaml`: wheels left and right; actions are (m/s, rad/s)."""

    kind: Literal["differential"] = Field(description="`differential`.")
    left: Annotated[list[PartName], Field(min_length=1)] = Field(
        description="Wheels on the left: names of joints, or of velocity actuators."
    )
    right: Annotated[list[PartName], Field(min_length=1)] = Field(description="Wheels on the right, likewise.")
    wheel_radius_m: Length = Field(description="Radius of the wheels, metres.")
    track_width_m: Length = Field(description="Distance between the left and the right wheels' middles, metres.")


class VelocityDriveModel(DriveLimits):
    """Drive in `robot.yaml` by velocity actuators of the base; actions are (m/s, rad/s)."""

    kind: Literal["velocity"] = Field(description="`velocity`.")
    frame: Literal["world", "base"] = Field(
        description="`world`: x and y move slides along the world's axes, yaw a hinge; `base`: x pushes forward."
    )
    x: PartName = Field(description="Joint or velocity actuator, m/s.")
    y: PartName | None = optional("Joint or velocity actuator, m/s; needed in the world's frame.")
    yaw: PartName = Field(description="Joint or velocity actuator, rad/s.")


class ActuatorsDriveModel(Model):
    """Drive in `robot.yaml` by direct actuator controls, in the model's order."""

    kind: Literal["actuators"] = Field(description="`actuators`.")
    max_linear_mps: Annotated[float, Field(gt=0, le=20, allow_inf_nan=False)] = Field(
        default=1.0, description="Forward velocity that it will not pass, m/s, for those who plan."
    )
    max_angular_radps: Annotated[float, Field(gt=0, le=50, allow_inf_nan=False)] = Field(
        default=1.0, description="Likewise, turning rate, rad/s."
    )


class RobotLidar(Model):
    """Horizontal lidar of a robot, in `robot.yaml`."""

    at: PartName | None = optional("Site or body (link) whose height it has.")
    height_m: Length | None = optional("Height over the floor instead, metres.")
    rate_hz: Literal[1, 2, 4, 5, 10, 20] = Field(default=5, description="Scans per second; robots act 20 times.")
    rays: Annotated[int, Field(ge=2, le=4096)] = Field(default=360, description="Rays in a scan.")
    field_of_view_deg: Annotated[float, Field(gt=0, le=360, allow_inf_nan=False)] = Field(
        default=360.0, description="Angle that the rays are spread over, half of it on each side of x, degrees."
    )
    range_min_m: Metres = Field(default=0.06, description="Shortest distance that it measures, metres.")
    range_max_m: Length = Field(default=3.5, description="Longest distance that it measures, metres.")
    noise_std_m: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = Field(
        default=0.005, description="Standard deviation of a distance, metres."
    )


class RobotCamera(Model):
    """Camera that `robot.yaml` adds to a robot."""

    name: PartName = Field(description="Its name.")
    at: PartName = Field(description="Body (link) that it is on; it looks along its x axis, z is up.")
    fovy_deg: Annotated[float, Field(gt=0, lt=180)] = Field(
        default=60.0, description="Vertical field of view, degrees."
    )


class FixedSensors(Model):
    """Sensors of a robot in `robot.yaml`, besides those of its joints."""

    lidar: RobotLidar | None = optional("Lidar, and sensors in the bumper; absent: none.")
    bumper_height_m: Length = Field(
        default=0.04, description="Height over the floor of the 15 range sensors that come with a lidar, metres."
    )
    cameras: list[RobotCamera] = Field(default=[], description="Cameras to add; those of an MJCF are there anyway.")

    def of_kinds(self) -> list[SensorKind]:
        """Sensors of the pluggable kinds, such as an IMU."""
        return [sensor for name in SENSOR_KINDS if (sensor := getattr(self, name)) is not None]


SENSOR_KINDS: Mapping[str, type[SensorKind]] = classes_of(
    SensorKind, sensors.__name__, "sensors", lambda kind: (kind.name,) if hasattr(kind, "name") else ()
)
"""Kinds of sensors by name."""


def check_kinds(kinds: Iterable[type[SensorKind]]) -> None:
    """Checks that sensor kinds have no conflicting names.

    Args:
        kinds: All kinds of sensors.

    Raises:
        ConfigurationError: Two kinds, or a kind and the simulation, use the same name.
    """
    topics = dict.fromkeys(PUBLISHED, "the simulation")
    for kind in kinds:
        who, name = f"{kind.__module__}.{kind.__name__}", kind.name
        uses = {
            "observations have it already": name in OBSERVED,
            "robot.yaml has it below sensors already": name in FixedSensors.model_fields or hasattr(FixedSensors, name),
            "a frame of the robot is called so": name in FRAMES,
            "it has to be a name in Python": not name.isidentifier() or name.startswith("_"),
        }
        if reasons := [why for why, is_so in uses.items() if is_so]:
            raise ConfigurationError(f"{who} cannot be called {name!r}: {reasons[0]}")
        if kind.topic and topics.setdefault(kind.topic, who) != who:
            raise ConfigurationError(f"{who} cannot have the topic {kind.topic}: {topics[kind.topic]} publishes on it")


check_kinds(SENSOR_KINDS.values())

if TYPE_CHECKING:
    RobotSensors: TypeAlias = FixedSensors
else:
    _OTHERS = {name: (kind | None, optional(f"{kind.__doc__} Absent: none.")) for name, kind in SENSOR_KINDS.items()}
    RobotSensors = create_model("RobotSensors", __base__=FixedSensors, __doc__=FixedSensors.__doc__, **_OTHERS)


class RobotModelHead(Model):
    """Members that every `robot.yaml` has in addition to its drive."""

    version: Literal[1] = Field(description="Version of this document's form: 1.")
    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)] | None = optional(
        "Short name, comes before the names of its parts in a world; absent: the folder's."
    )
    model: Annotated[str, Field(min_length=1)] = Field(
        description="MJCF, URDF or SDF file, relative to this; `menagerie:<model>/<file>` is one of MuJoCo Menagerie."
    )
    base: PartName = Field(description="Body (link) that all others hang on; x points forward, z up.")
    footprint: RobotFootprint = Field(description="The room that it takes on the floor.")
    spawn: RobotSpawn = Field(description="How it stands at the start.")
    actuators: list[AddedActuator] = Field(default=[], description="Actuators to add to the model's own.")
    sensors: RobotSensors = Field(default=RobotSensors(), description="Sensors of the robot.")
    sliding: list[PartName] = Field(
        default=[],
        description="Bodies (links) or geoms that slide over the floor, such as casters made of balls: next to no "
        "friction.",
    )
    impossible_inertia: Literal["refuse", "from_geometry"] = Field(
        default="refuse",
        description="Treatment of links of a URDF or SDF whose mass or inertia no body can have: `refuse`, or "
        "`from_geometry`: they get that of their shapes, with their mass where it is possible, and a warning.",
    )
    joints: list[PartName] | None = optional("Joints to observe and to record; absent: all hinges and slides.")
    video_camera: PartName | None = optional("Camera for videos; absent: one that follows it is added.")
    ros: RosOptions | None = optional(
        "Names, frames and timing for ROS nodes that drive it; the launch variable `ROBOMAKER_ROS` goes before them."
    )


class DifferentialRobotModel(RobotModelHead):
    """A `robot.yaml` of a robot on driven wheels."""

    drive: DifferentialDriveModel = Field(description="How it moves.")


class VelocityRobotModel(RobotModelHead):
    """A `robot.yaml` of a robot whose base is moved by velocity actuators."""

    drive: VelocityDriveModel = Field(description="How it moves.")


class ActuatorsRobotModel(RobotModelHead):
    """A `robot.yaml` of a robot with direct actuator controls."""

    drive: ActuatorsDriveModel = Field(description="How it moves.")


RobotModel: TypeAlias = DifferentialRobotModel | VelocityRobotModel | ActuatorsRobotModel

ROBOT_MODELS: dict[str, type[RobotModel]] = {
    "differential": DifferentialRobotModel,
    "velocity": VelocityRobotModel,
    "actuators": ActuatorsRobotModel,
}


def robot_model_type(document: Any) -> type[RobotModel]:
    """Returns the pydantic model for a `robot.yaml` document, chosen by its `drive.kind`."""
    drive = document.get("drive") if is_object(document) else None
    kind = drive.get("kind") if is_object(drive) else None
    return ROBOT_MODELS.get(kind, DifferentialRobotModel) if isinstance(kind, str) else DifferentialRobotModel
