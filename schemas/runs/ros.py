"""Options of the ROS bridge, in the variable `ROBOMAKER_ROS` or the part `ros` of a `robot.yaml`."""

import json
from difflib import get_close_matches
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from ..wire.base import Model, optional

ROS_VARIABLE = "ROBOMAKER_ROS"
"""A launch variable: `1`, `2` or `off`, or options of the bridge as JSON."""

TopicName = Annotated[str, Field(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$")]
FrameName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_./-]+$")]
RosTime = Literal["paced", "free", "lockstep"]
Suite = Literal[1, 2]


_SHOWN, _SHOWN_PROBLEMS = 80, 3


class RosOptions(Model):
    """How ROS nodes drive in a simulation."""

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
    base_frame: FrameName = Field(default="base_link", description="Frame of the robot's base.")
    odom_frame: FrameName = Field(default="odom", description="Frame in which odometry is.")
    map_frame: FrameName = Field(default="map", description="Frame of the map and of goals.")
    scan_frame: FrameName = Field(default="base_scan", description="Frame of the lidar.")
    topics: dict[TopicName, TopicName | None] = Field(
        default={}, description="Other names for topics, such as `/scan: /laser`; null: the topic is not published."
    )
    peers: list[str] = Field(
        default=[], description="ROS 2: addresses of machines that the robot's nodes run on; empty: only this one."
    )
    interface: str | None = optional("ROS 2: network interface, `eth0`; absent: only this machine's loopback.")


class RosPlan(Model):
    """The ROS bridge of a run."""

    suite: Suite = Field(description="ROS that the nodes speak, 1 or 2.")
    domain: int = Field(ge=0, le=232, description="Domain of ROS 2 that the nodes are in.")
    options: RosOptions = Field(default=RosOptions(), description="Options of the launch configuration.")


def parse_ros(text: str) -> RosOptions | None:
    """Reads the value of `ROBOMAKER_ROS`.

    Returns:
        The options; none for `off`.

    Raises:
        ValueError: It is something else; says what would be right.
    """
    if text == "off":
        return None
    if text in ("1", "2"):
        return RosOptions(suite=1 if text == "1" else 2)
    wanted = f'{ROS_VARIABLE} has to be 1, 2, off, or options as JSON, such as {{"time": "lockstep"}}'
    try:
        given = json.loads(text)
    except ValueError:
        raise ValueError(f"{wanted}; it is {text[:_SHOWN]!r}") from None
    if not isinstance(given, dict):
        raise ValueError(f"{wanted}; it is {text[:_SHOWN]!r}")
    try:
        return RosOptions.model_validate(given)
    except ValidationError as error:
        raise ValueError("; ".join(_problem(each) for each in error.errors()[:_SHOWN_PROBLEMS])) from None


def _problem(error: Any) -> str:
    where = ".".join(map(str, error["loc"]))
    if error["type"] == "extra_forbidden":
        near = get_close_matches(where, RosOptions.model_fields, n=1)
        known = f"did you mean {near[0]}?" if near else f"known are {', '.join(RosOptions.model_fields)}"
        return f"{ROS_VARIABLE}: {where} is not known; {known}"
    return f"{ROS_VARIABLE}: {where}: {str(error['input'])[:_SHOWN]!r}: {error['msg']}"
