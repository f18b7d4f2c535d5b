"""Options of the ROS bridge, from the variable `ROBOMAKER_ROS` or the part `ros` of a `robot.yaml`."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from ..wire.base import Model, optional
from ..wire.errors import InvalidParameterException
from ..wire.job_configs import MAX_VARIABLE_CHARACTERS, JobRequest, launches
from ..wire.json_values import load_strict
from ..wire.request_problems import parsed_member

ROS_VARIABLE = "ROBOMAKER_ROS"
"""Name of the launch variable with `1`, `2` or `off`, or options of the bridge as JSON."""

KnownTopic = Literal[
    "/camera/camera_info",
    "/camera/depth/camera_info",
    "/camera/depth/image_raw",
    "/camera/depth/points",
    "/camera/image_raw",
    "/camera/image_raw/compressed",
    "/clock",
    "/cmd_vel",
    "/goal_pose",
    "/imu",
    "/initialpose",
    "/joint_states",
    "/map",
    "/odom",
    "/robot_description",
    "/scan",
    "/tf",
    "/tf_static",
]
"""Topics that the bridge publishes, and `/cmd_vel`, to which it subscribes."""

TopicName = Annotated[str, Field(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$")]
FrameName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_./-]+$")]
RosTime = Literal["paced", "free", "lockstep"]
Suite = Literal[1, 2]


_SHOWN = 80


class RosOptions(Model):
    """User options of the ROS bridge: how ROS nodes drive a robot in the simulation."""

    suite: Suite | None = optional(
        "ROS that the nodes speak, 1 or 2; absent: that of the launch file, else of the application's "
        "`robotSoftwareSuite`."
    )
    time: RosTime = Field(
        default="paced",
        description="How simulated time passes: `paced` runs at most `ahead_s` ahead of the newest command; `free` "
        "runs at `real_time_factor` times real time; `lockstep` waits for the command that answers a step.",
    )
    ahead_s: float = Field(
        default=0.25, gt=0, le=60, description="`paced`: simulated seconds that may pass after the newest command."
    )
    real_time_factor: float = Field(
        default=1.0,
        gt=0,
        le=1000,
        description="`free` and `paced`: simulated seconds in a second, at most.",
    )
    answer_timeout_s: float = Field(
        default=5.0,
        gt=0,
        le=3600,
        description="`lockstep`: wall-clock seconds that a command is waited for.",
    )
    answers: Literal["scan", "step"] = Field(
        default="scan",
        description="`lockstep`: whether a command is waited for after every scan of the lidar, where the robot has "
        "one, or after every step.",
    )
    command_timeout_s: float = Field(
        default=0.5, gt=0, description="Simulated seconds after which the robot stops without a new command."
    )
    localization: Literal["robot", "truth"] = Field(
        default="robot",
        description="`truth`: the bridge publishes `/map` and where `odom` is in `map`; `robot`: nodes find that out.",
    )
    goals: bool = Field(
        default=True, description="Whether the next room that has to be visited is published on `/goal_pose`."
    )
    camera_rate_hz: float = Field(
        default=5.0,
        gt=0,
        le=60,
        description="Pictures per simulated second on topics of the camera that nodes subscribe; where a job records "
        "its camera, the rate of that counts.",
    )
    depth_encoding: Literal["32FC1", "16UC1"] = Field(
        default="32FC1",
        description="Pixels of `/camera/depth/image_raw`: `32FC1`, metres, infinite where nothing is seen, or `16UC1`, "
        "millimetres, 0 where nothing is seen or it is farther than 65.535 m.",
    )
    base_frame: FrameName = Field(default="base_link", description="Frame of the robot's base.")
    odom_frame: FrameName = Field(default="odom", description="Frame in which odometry is.")
    map_frame: FrameName = Field(default="map", description="Frame of the map and of goals.")
    scan_frame: FrameName = Field(default="base_scan", description="Frame of the lidar.")
    topics: dict[KnownTopic, TopicName | None] = Field(
        default={}, description="Other names for topics, such as `/scan: /laser`; null: the topic is not published."
    )
    peers: list[str] = Field(
        default=[], description="ROS 2: addresses of machines that the robot's nodes run on; empty: only this one."
    )
    interface: str | None = optional("ROS 2: network interface, `eth0`; absent: only this machine's loopback.")

    @model_serializer(mode="wrap")
    def _given(self, whole: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Serialises only the options that were given, as another process may read the others from `robot.yaml`."""
        return {name: value for name, value in whole(self).items() if name in self.model_fields_set}

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        if self.topics.get("/cmd_vel", "") is None:
            raise ValueError("topics: /cmd_vel is how nodes drive, so that it cannot be left out")
        names = [name for name in self.topics.values() if name is not None]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"topics: two of them are called {twice[0]}")
        return self


NOT_OF_ROBOTS = ("suite", "peers", "interface")
"""Options that are needed before a robot's `robot.yaml` is read, so that the file cannot have them."""


class RosPlan(Model):
    """Plan of a run's ROS bridge: ROS version, domain and options."""

    suite: Suite = Field(description="ROS version of the nodes, 1 or 2.")
    domain: int = Field(ge=0, le=232, description="ROS 2 domain id of the nodes.")
    options: RosOptions = Field(default=RosOptions(), description="ROS options of the launch configuration.")


class _Holder(Model):
    ros: RosOptions


def parse_ros(text: str, place: str) -> RosOptions | None:
    """Parses the value of the launch variable `ROBOMAKER_ROS`, the options of the ROS bridge.

    Args:
        text: Value of the variable.
        place: Path of the variable, for errors.

    Returns:
        The options; none for `off`.

    Raises:
        InvalidParameterException: The value is not a valid set of options; the message says what would be right.
    """
    if text == "off":
        return None
    if text in ("1", "2"):
        return RosOptions(suite=1 if text == "1" else 2)
    if not text.lstrip().startswith("{"):
        raise InvalidParameterException(
            f"{place} is {text[:_SHOWN]!r}; 1, 2, off, or options as JSON would be right, such as "
            '{"time": "lockstep"}'
        )
    return parsed_member(load_strict(text, place, MAX_VARIABLE_CHARACTERS), place, "ros", _Holder)


def wrong_ros(request: JobRequest) -> Iterator[str]:
    """Yields problems of ROS bridge options in the launch variables of a simulation job request."""
    for place, launch in launches(request):
        if (text := (launch.environmentVariables or {}).get(ROS_VARIABLE)) is not None:
            try:
                parse_ros(text, f"{place}.environmentVariables.{ROS_VARIABLE}")
            except InvalidParameterException as error:
                yield from str(error).splitlines()
