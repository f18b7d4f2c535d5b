"""Request to the recorder of ROS topics, and its report of what was and was not recorded."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from ....schemas.wire.base import Model, optional
from ....schemas.wire.common import counted

MODULE = "prefect_robomaker.tasks.runtime.ros.topic_recorder"
"""Python module of the topic recorder."""
LogTimes = Literal["clock", "elapsed", "sent"]
MAX_REPORT_BYTES = 16 * 1024 * 1024
_SHOWN = 20
"""Maximum number of topics that a note names."""
_QUIET = frozenset({"/parameter_events", "/rosout"})
"""Topics that every node has, and that often have no messages."""
_LOG = "rcl_interfaces/msg/Log"
"""Type of log messages, each of which is unique; of periodic messages, single ones may be lost without harm."""


def part_path(folder: Path, number: int) -> Path:
    """Returns the path of the file of the topic recorder's n-th start."""
    return folder / f"ros-topics.{number}.mcap"


def report_path(part: Path) -> Path:
    """Returns the path of the report about one of the topic recorder's files."""
    return part.with_suffix(".json")


class RecorderRequest(Model):
    """Request to the topic recorder: domain, files and limits."""

    output_dir: Path = Field(description="Folder for the recording.")
    times: LogTimes = Field(
        description="Log times: simulated time, from `/clock`; time since the recorder's start; or the time at which "
        "messages were sent, since 1970."
    )
    max_bytes: int = Field(gt=0, description="Bytes of all messages that are recorded.")
    packages: list[Path] = Field(
        default=[], description="Folders below which packages have `.msg` and `.srv` files of types."
    )
    interface: str | None = optional("Network interface, `eth0`; absent: the loopback.")
    peers: list[str] = Field(default=[], description="Addresses of other machines that nodes run on.")


class TopicReport(Model):
    """Report about one topic that the topic recorder found: messages, losses and problems."""

    name: str = Field(description="Its name, `/odom`.")
    type: str = Field(description="Its type, `nav_msgs/msg/Odometry`.")
    messages: int = Field(default=0, ge=0, description="Messages that were recorded.")
    is_defined: bool = Field(default=True, description="Whether the recording has a definition of its type.")
    left_out: int = Field(default=0, ge=0, description="Messages beyond the limit, which were not recorded.")
    lost: int = Field(default=0, ge=0, description="Messages that were lost on their way to the recorder.")
    problem: str | None = optional("Why it is not recorded; absent: it is.")


class RecorderReport(Model):
    """Report of the topic recorder, rewritten whenever it changes."""

    domain: int = Field(description="Domain of ROS 2.")
    topics: list[TopicReport] = Field(default=[], description="Topics that it has heard of.")


def notes_of(reports: Sequence[RecorderReport], starts: int) -> list[str]:
    """Returns notes for people about a recording of ROS topics, such as lost messages.

    Args:
        reports: Reports that were found.
        starts: Number of starts of the recorder, as far as its files show.
    """
    topics = [topic for report in reports for topic in report.topics]
    if reports and not topics:
        return [f"ROS topics: no node was heard in domain {reports[-1].domain}, so none is recorded"]
    notes: list[str] = []
    if starts > 1:
        notes.append(f"ROS topics: their recorder was started {starts} times; what came in between is not recorded")
    recorded = {(topic.name, topic.type) for topic in topics if topic.messages}
    silent = [
        topic for topic in topics
        if not (topic.problem or topic.left_out or topic.name in _QUIET or (topic.name, topic.type) in recorded)
    ]  # fmt: skip
    groups = (
        ("not recorded", [f"{topic.name} ({topic.problem})" for topic in topics if topic.problem]),
        (
            "left out from the recording's limit on",
            [f"{topic.name} ({topic.left_out} messages)" for topic in topics if topic.left_out],
        ),
        ("lost before they were recorded", [f"{topic.name} ({topic.lost})" for topic in topics if topic.lost]),
        (
            "recorded without a definition of their type",
            [f"{topic.name} ({topic.type})" for topic in topics if topic.messages and not topic.is_defined],
        ),
        ("announced, and no message came", [topic.name for topic in silent]),
    )
    return notes + [f"ROS topics {what}: {_listed(names)}" for what, names in groups if names]


def unrecorded_commands(reports: Sequence[RecorderReport], about: Mapping[str, Any]) -> list[str]:
    """Returns a note about velocity commands that the bridge took and the recorder missed; an empty list: none.

    A node may send before the recorder has found it. Of a run in lock-step that may be much of the simulated time.

    Args:
        reports: Reports that were found.
        about: Figures of the bridge in the run's result.
    """
    name, taken = about.get("command_topic"), about.get("commands")
    heard = [topic for report in reports for topic in report.topics if topic.name == name]
    recorded = sum(topic.messages for topic in heard)
    told = sum(topic.lost + topic.left_out for topic in heard)  # by notes of their own
    if not isinstance(taken, int) or recorded + told >= taken:
        return []
    return [
        f"ROS topics: {recorded} of {counted(taken, 'command')} on {name} are recorded; those are missing that were "
        "sent before the recorder had found the node"
    ]


def losses_of(reports: Sequence[RecorderReport], starts: int) -> dict[str, str]:
    """Returns reasons why topics are not recorded completely, by topic; complete topics are not included.

    Args:
        reports: Reports that were found.
        starts: Number of starts of the recorder, as far as its files show.
    """
    found: dict[str, str] = {}
    for topic in (topic for report in reports for topic in report.topics):
        if starts > 1:
            found[topic.name] = f"its recorder was started {starts} times, and what came in between is not recorded"
        elif topic.problem:
            found[topic.name] = f"a publisher of it is not recorded ({topic.problem})"
        elif topic.left_out:
            found[topic.name] = f"{topic.left_out} messages were left out from the recording's limit on"
        elif topic.lost and topic.type == _LOG:
            found[topic.name] = f"{topic.lost} messages were lost before they were recorded"
    return found


def _listed(names: Iterable[str]) -> str:
    every = sorted(set(names))
    more = len(every) - _SHOWN
    return ", ".join(every[:_SHOWN]) + (f" and {more} more" if more > 0 else "")
