"""Topics of a recording by which requirements are measured, in a requirements file or `ROBOMAKER_SOURCES`."""

from collections.abc import Iterator, Mapping
from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional
from ..wire.errors import InvalidParameterException
from ..wire.job_configs import MAX_VARIABLE_CHARACTERS, JobRequest, launches
from ..wire.json_values import load_strict
from ..wire.request_problems import parsed_member
from .ros_options import FrameName, TopicName

SOURCES_VARIABLE = "ROBOMAKER_SOURCES"
"""Name of the launch variable with `RecordingSources` as JSON."""

RECORDED_RUN = "recorded-run"
"""Name of the simulation application that replays a recording, so that it can be judged."""


class RecordingSources(Model):
    """Topics of a ROS recording by which a robot's run is judged (pose, contacts, scan), and their frames."""

    pose: TopicName | None = optional(
        "Topic with the robot's pose: `Odometry`, `PoseStamped`, `PoseWithCovarianceStamped`, `TransformStamped`, or "
        "`/tf`; absent: `/tf` from the map to the base, else `/odom`, else `/tf` from `odom` to the base."
    )
    map_frame: FrameName = Field(default="map", description="Frame in which goals and rooms are.")
    base_frame: FrameName | None = optional("Frame of the robot's base; absent: `base_link`, else `base_footprint`.")
    contacts: list[TopicName] = Field(
        default=[],
        max_length=50,
        description="Topics with contacts: `gazebo_msgs/ContactsState`, `ros_gz_interfaces/Contacts`, or `/contacts` "
        "of our own recordings; empty: all that have these types.",
    )
    contacts_on_touch: bool = Field(
        default=False,
        description="Whether topics with contacts speak only when something is touched, so that a silent one says that "
        "nothing was; else its sensor could have been off, which is an error.",
    )
    robot: str | None = Field(
        default=None,
        min_length=1,
        max_length=255,
        description="Gazebo's name of the robot's model, which names its side of a contact: `turtlebot3`.",
    )
    scan: TopicName | None = optional("Topic with a `LaserScan`; absent: `/scan`, else the only one.")
    radius_m: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="Radius of the robot around its base, seen from above, in metres; clearance needs it.",
    )
    partial_scan: bool = Field(
        default=False,
        description="Whether clearance is judged by a scan that does not see all around the robot; what is elsewhere "
        "is missed then.",
    )
    time: Literal["clock", "received"] | None = optional(
        "Time of messages: `clock`, the last `/clock` before them, or `received`, seconds since the recording's first "
        "message; absent: `clock` where the recording has it."
    )
    start_s: float = Field(
        default=0.0,
        ge=0,
        allow_inf_nan=False,
        description="Time in the recording at which the run begins, in seconds: what was before is not judged, and "
        "times count from there.",
    )
    ends_with_run: bool = Field(
        default=False,
        description="Whether the run was over where the recording ends; else it may be cut short, and a time limit "
        "that it does not reach is an error, unless all goals were reached.",
    )
    max_gap_s: float = Field(
        default=1.0,
        gt=0,
        allow_inf_nan=False,
        description="Longest silence of a topic, in seconds; in a longer one something could have been missed.",
    )


class _Holder(Model):
    sources: RecordingSources


def parse_sources(data: object, what: str) -> RecordingSources:
    """Parses the topics by which a recording is judged from plain values.

    Args:
        data: The values.
        what: Name of the source of the values, for error messages.

    Raises:
        InvalidParameterException: One line per problem: where, what, and what would be right.
    """
    return parsed_member(data, what, "sources", _Holder)


def sources_in(variables: Mapping[str, str], place: str = SOURCES_VARIABLE) -> RecordingSources:
    """Reads the topics by which a recording is judged from a launch variable; without it, the default topics.

    Args:
        variables: Variables of a launch configuration.
        place: Path of the variable, for errors.

    Raises:
        InvalidParameterException: The launch variable is not a valid choice of topics; the message says what would be
            right.
    """
    text = variables.get(SOURCES_VARIABLE)
    if text is None:
        return RecordingSources()
    return parse_sources(load_strict(text, place, MAX_VARIABLE_CHARACTERS), place)


def is_recorded_run(application: str) -> bool:
    """Returns whether a name or an ARN is that of the simulation application that replays recordings."""
    return application == RECORDED_RUN or f"/{RECORDED_RUN}/" in application


def wrong_sources(request: JobRequest) -> Iterator[str]:
    """Yields problems of recording topics in a request's launch variables, and robots that would not be run."""
    for index, config in enumerate(request.simulationApplications or ()):
        if is_recorded_run(config.application) and request.robotApplications:
            yield (
                f"robotApplications: simulationApplications[{index}].application, {RECORDED_RUN}, judges a robot that "
                "has driven already, so that a robot application would not be run; leave out robotApplications"
            )
    for place, launch in launches(request):
        try:
            sources_in(launch.environmentVariables or {}, f"{place}.environmentVariables.{SOURCES_VARIABLE}")
        except InvalidParameterException as error:
            yield from str(error).splitlines()
