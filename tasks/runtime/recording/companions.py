"""Files written next to a recording: a Foxglove layout and rosbag2's `metadata.yaml`."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

LAYOUT_FILE = "foxglove-layout.json"
WORLD_TOPIC = "/world"
"""Topic with the markers of floors, walls and furniture."""

_COLOURS = ("#4e98e2", "#f5774d", "#f7df71", "#5cd6a9")
_POSES, _SCANS = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"
_JOINTS, _PICTURES = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CompressedImage"
_CAMERAS = "sensor_msgs/msg/CameraInfo"
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_DRAWN: Mapping[str, dict[str, Any]] = {
    # Without a field Foxglove colours scans by their intensities in every mode.
    _SCANS: {"pointSize": 4, "colorField": "range", "colorMode": "flat", "flatColor": "#ff6b2dff"},
    # It would cover the floor.
    "nav_msgs/msg/OccupancyGrid": {"visible": False},
    _POSES: {"type": "axis", "axisScale": 0.4},
    "geometry_msgs/msg/PoseStamped": {"type": "arrow", "color": "#28c76fff"},
    "nav_msgs/msg/Path": {"type": "line", "lineWidth": 0.03, "gradient": ["#28c76fff", "#28c76fff"]},
    "visualization_msgs/msg/MarkerArray": {},
}
"""Display settings of Foxglove's 3D panel for topics, by ROS type."""

Panel = tuple[str, dict[str, Any]]


def layout(topics: Mapping[str, str]) -> dict[str, Any]:
    """Makes a Foxglove layout (panels) for a recording's topics, to be opened with "Import from file".

    It has a 3D panel if any topic can be drawn, the images of cameras, plots of speeds and joints, and a panel of raw
    messages.

    Args:
        topics: ROS type of each topic.
    """
    scene = [*_scene(topics), *_pictures(topics)]
    numbers = [*_plots(topics), *_raw(topics)]
    panels = dict([*scene, *numbers])
    columns = [_stack(scene, 60 if len(scene) == 2 else None), _stack(numbers)]
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split([column for column in columns if column], "row", 65),
    }


def _scene(topics: Mapping[str, str]) -> list[Panel]:
    drawn = {topic: {"visible": True, **_DRAWN[kind]} for topic, kind in topics.items() if kind in _DRAWN}
    if not drawn or _TRANSFORMS not in topics.values():
        return []
    cameras = [topic for topic, kind in topics.items() if kind == _CAMERAS]
    drawn |= {topic: {"visible": True, "distance": 0.3, "planarProjectionFactor": 1} for topic in cameras}
    config = {
        "followMode": "follow-position",
        "followTf": "base_link",
        "cameraState": {
            "perspective": True,
            "distance": 9,
            "phi": 35,
            "thetaOffset": 20,
            "targetOffset": [0, 0, 0],
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.05,
            "far": 500,
        },
        "layers": {
            "grid": {
                "layerId": "foxglove.Grid",
                "visible": WORLD_TOPIC not in topics,  # which has floors
                "size": 20,
                "divisions": 20,
            }
        },
        # Axes without names and lines between them, which would hide the robot.
        "scene": {"transforms": {"showLabel": False, "axisScale": 0.1, "lineWidth": 0}},
        "topics": drawn,
    }
    return [("3D!scene", config)]


def _pictures(topics: Mapping[str, str]) -> list[Panel]:
    names = [topic for topic, kind in topics.items() if kind == _PICTURES]
    return [(f"Image!camera{number}", {"imageMode": _image(topic, topics)}) for number, topic in enumerate(names)]


def _image(topic: str, topics: Mapping[str, str]) -> dict[str, Any]:
    """Makes an image panel for a camera, onto which the scene is drawn with the camera's `CameraInfo` topic."""
    info = f"{topic.partition('/image')[0]}/camera_info"
    return {"imageTopic": topic, **({"calibrationTopic": info} if info in topics else {})}


def _plots(topics: Mapping[str, str]) -> list[Panel]:
    panels = []
    for topic, kind in topics.items():
        name = topic.strip("/").replace("/", "-")
        if kind == _POSES:
            speeds = {"ahead (m/s)": "linear.x", "turning (rad/s)": "angular.z"}
            paths = {label: f"{topic}.twist.twist.{member}" for label, member in speeds.items()}
            panels.append((f"Plot!{name}", _plot("Speed", paths)))
        elif kind == _JOINTS:
            paths = {f"joint {number} (1/s)": f"{topic}.velocity[{number}]" for number in range(2)}
            panels.append((f"Plot!{name}", _plot("Joints", paths)))
    return panels


def _plot(title: str, paths: Mapping[str, str]) -> dict[str, Any]:
    """Returns the description of a Foxglove plot of message paths, given by their labels."""
    lines = [
        {"value": path, "label": label, "enabled": True, "timestampMethod": "receiveTime", "color": colour}
        for (label, path), colour in zip(paths.items(), _COLOURS, strict=False)
    ]
    return {
        "foxglovePanelTitle": title,
        "paths": lines,
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }


def _raw(topics: Mapping[str, str]) -> list[Panel]:
    """Returns a Foxglove panel with the raw messages of the most informative topic; none without topics."""
    ranked = [topic for kind in (_POSES, _JOINTS) for topic, type_ in topics.items() if type_ == kind] or [*topics]
    return [("RawMessages!messages", {"topicPath": ranked[0]})] if ranked else []


def _stack(panels: Sequence[Panel], percentage: float | None = None) -> Any:
    return _split([name for name, _ in panels], "column", percentage)


def _split(parts: Sequence[Any], direction: str, percentage: float | None = None) -> Any:
    """Arranges panels side by side or one below the other, in equal shares unless the first one's share is given.

    A single panel is returned as it is, and no panel is an empty text.

    Args:
        parts: The panels.
        direction: `row` or `column`, as Foxglove has it.
        percentage: Share of the first panel, in percent.
    """
    if len(parts) < 2:
        return parts[0] if parts else ""
    return {
        "first": parts[0],
        "second": _split(parts[1:], direction),
        "direction": direction,
        "splitPercentage": percentage or round(100 / len(parts), 1),
    }


METADATA_FILE = "metadata.yaml"
_VERSION = 9
_LATCHED = frozenset({"/tf_static", "/goals", "/map", "/world", "/robot", "/robot_description"})
"""Topics that are published once; a player has to keep their messages for later subscribers."""


class Offer(NamedTuple):
    """Quality of service (QoS) of a ROS topic's publisher: latched, reliable, and number of messages that are kept."""

    is_latched: bool = False
    """Whether later subscribers get the last messages (QoS durability `transient_local`)."""

    is_reliable: bool = True
    """Whether lost messages are sent again (QoS reliability `reliable`)."""

    depth: int = 10
    """Number of messages that are kept for a subscriber (QoS history depth)."""


def own_offer(topic: str) -> Offer:
    """Returns the quality of service (QoS) of a topic that the simulation publishes."""
    return Offer(is_latched=topic in _LATCHED)


_INFINITE = "{sec: 9223372036, nsec: 854775807}"
_QOS = f"""\
- history: %s
  depth: %d
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
    """A topic of a recording: name, type, number of messages and quality of service."""

    name: str
    """Topic name, such as `/odom`."""

    type: str
    """ROS type, such as `nav_msgs/msg/Odometry`."""

    type_hash: str
    """Hash of the type, `RIHS01_…`."""

    messages: int
    """Number of the topic's messages in the recording."""

    offer: Offer | None = None
    """Quality of service (QoS) of the recorded topic; `None`: that of the simulation's topic of this name."""


def channel_metadata(topic: str, type_hash: str, offer: Offer | None = None) -> dict[str, str]:
    """Returns the metadata that `rosbag2_storage_mcap` stores for a topic in an MCAP file.

    `ros2 bag play` publishes a topic with the quality of service that is stored here.

    Args:
        topic: Topic name.
        type_hash: The hash of its type, `RIHS01_…`.
        offer: Quality of service of the topic; `None`: that of the simulation's topic of this name.
    """
    is_latched, is_reliable, depth = offer or own_offer(topic)
    # Numbers, as all versions read them here: keep last, reliable or not, transient local or volatile, automatic.
    qos = _QOS % (1, depth, 1 if is_reliable else 2, 1 if is_latched else 2, 1)
    return {"offered_qos_profiles": qos, "topic_type_hash": type_hash}


_OFFERED = re.compile(r"^  (depth|reliability|durability): (\d+)$", re.MULTILINE)


def offer_in(noted: Mapping[str, str]) -> Offer:
    """Returns the quality of service that a topic's metadata in a recording names, with defaults for what is absent."""
    found = {name: int(number) for name, number in _OFFERED.findall(noted.get("offered_qos_profiles", ""))}
    return Offer(found.get("durability") == 1, found.get("reliability", 1) == 1, found.get("depth", 10))


def metadata(path: str, topics: Sequence[RecordedTopic], start_ns: int, end_ns: int) -> str:
    """Returns the text of a recording's `metadata.yaml`, which `ros2 bag` needs.

    Args:
        path: File name of the recording, in the same folder.
        topics: Topics in the recording.
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
    is_latched, is_reliable, depth = topic.offer or own_offer(topic.name)
    reliability = "reliable" if is_reliable else "best_effort"
    durability = "transient_local" if is_latched else "volatile"
    qos = _QOS % ("keep_last", depth, reliability, durability, "automatic")
    indented = "\n".join(" " * 10 + line for line in qos.splitlines())
    return _TOPIC.format(
        name=_quoted(topic.name), type=topic.type, qos=indented, hash=topic.type_hash or '""', count=topic.messages
    )


def _quoted(text: str) -> str:
    """Returns a name quoted for YAML; applications may use any characters."""
    return "'" + text.replace("'", "''") + "'"
