"""Makes a folder with a recording a rosbag2: `metadata.yaml`, and the topics' QoS profiles.

The format is that of `rosbag2_storage`'s `metadata_io`, version 9 (Jazzy and later).
"""

from collections.abc import Sequence
from typing import NamedTuple

METADATA_FILE = "metadata.yaml"
_VERSION = 9
_LATCHED = frozenset({"/tf_static", "/goals", "/map", "/world", "/robot"})
"""Topics that are sent once; a player has to keep them for subscribers that come later."""
_INFINITE = "{sec: 9223372036, nsec: 854775807}"
_QOS = f"""\
- history: %s
  depth: 10
  reliability: %s
  durability: %s
  deadline: {_INFINITE}
  lifespan: {_INFINITE}
  liveliness: %s
  liveliness_lease_duration: {_INFINITE}
  avoid_ros_namespace_conventions: false
"""
_METADATA = """\
rosbag2_bagfile_information:
  version: {version}
  storage_identifier: mcap
  duration:
    nanoseconds: {duration_ns}
  starting_time:
    nanoseconds_since_epoch: {start_ns}
  message_count: {count}
  topics_with_message_count:{topics}
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - {path}
  files:
    - path: {path}
      starting_time:
        nanoseconds_since_epoch: {start_ns}
      duration:
        nanoseconds: {duration_ns}
      message_count: {count}
  custom_data: ~
  ros_distro: prefect-robomaker
"""
_TOPIC = """
    - topic_metadata:
        name: {name}
        type: {type}
        serialization_format: cdr
        offered_qos_profiles:
{qos}
        type_description_hash: {hash}
      message_count: {count}"""


class RecordedTopic(NamedTuple):
    """A topic of a recording."""

    name: str
    """Name, such as `/odom`."""

    type: str
    """Type, such as `nav_msgs/msg/Odometry`."""

    type_hash: str
    """Hash of the type, `RIHS01_…`."""

    messages: int
    """Number of messages."""


def channel_metadata(topic: str, type_hash: str) -> dict[str, str]:
    """Returns what `rosbag2_storage_mcap` notes of a topic in the file itself.

    `ros2 bag play` offers a topic as it was offered when it was recorded.
    """
    # Numbers, as all versions read them here: keep last, reliable, transient local or volatile, automatic.
    qos = _QOS % (1, 1, 1 if topic in _LATCHED else 2, 1)
    return {"offered_qos_profiles": qos, "topic_type_hash": type_hash}


def metadata(path: str, topics: Sequence[RecordedTopic], start_ns: int, end_ns: int) -> str:
    """Returns the text of `metadata.yaml`.

    Args:
        path: Name of the recording, in the same folder.
        topics: What it has.
        start_ns: Log time of the first message.
        end_ns: Log time of the last message.
    """
    return _METADATA.format(
        version=_VERSION,
        duration_ns=max(0, end_ns - start_ns),
        start_ns=start_ns,
        count=sum(topic.messages for topic in topics),
        topics="".join(map(_topic, topics)) or " []",
        path=_quoted(path),
    )


def _topic(topic: RecordedTopic) -> str:
    durability = "transient_local" if topic.name in _LATCHED else "volatile"
    qos = _QOS % ("keep_last", "reliable", durability, "automatic")
    indented = "\n".join(" " * 10 + line for line in qos.splitlines())
    return _TOPIC.format(
        name=_quoted(topic.name), type=topic.type, qos=indented, hash=topic.type_hash, count=topic.messages
    )


def _quoted(text: str) -> str:
    """Quotes a name as YAML; applications may use any characters."""
    return "'" + text.replace("'", "''") + "'"
