"""Options of the ROS bridge, in the variable `ROBOMAKER_ROS` or the part `ros` of a `robot.yaml`."""

from typing import Annotated, Literal

from pydantic import Field

from ..wire.base import Model, optional

ROS_VARIABLE = "ROBOMAKER_ROS"
"""A launch variable: `1`, `2` or `off`, or options of the bridge as JSON."""

TopicName = Annotated[str, Field(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$")]
FrameName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_./-]+$")]
RosTime = Literal["paced", "free", "lockstep"]
Suite = Literal[1, 2]


class RosOptions(Model):
    """How ROS nodes drive in a simulation."""

    suite: Suite | None = optional(
        "ROS that the nodes speak, 1 or 2; absent: that of the launch file, else of the application's "
        "`robotSoftwareSuite`."
    )
    time: RosTime = Field(
        default="paced",
        description="How simulated time passes: `paced` runs at most `ahead_s` ahead of the newest command; `free` runs "
        "at `real_time_factor` times real time; `lockstep` waits for a command after every step.",
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
        description="`lockstep` and `paced`: wall-clock seconds that a command is waited for.",
    )
    every_steps: int = Field(default=1, ge=1, description="`lockstep`: steps between two commands that are waited for.")
    connect_timeout_s: float = Field(
        default=60.0, gt=0, le=86400, description="Wall-clock seconds in which the nodes have to be there."
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
