"""Bags written with `rosbags` alone: what robots and Gazebo record, in each format, and a simulated run as a real robot
would have recorded it."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

FORMATS = ("mcap", "sqlite", "ros1")
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"
SCAN = "sensor_msgs/msg/LaserScan"
CLOCK = "rosgraph_msgs/msg/Clock"
STATES = "gazebo_msgs/msg/ContactsState"
MODELS = "gazebo_msgs/msg/ModelStates"
_STATE = (
    "string info\nstring collision1_name\nstring collision2_name\ngeometry_msgs/Wrench[] wrenches\n"
    "geometry_msgs/Wrench total_wrench\ngeometry_msgs/Vector3[] contact_positions\n"
    "geometry_msgs/Vector3[] contact_normals\nfloat64[] depths\n"
)
EPOCH_S = 1_760_000_000
"""Wall-clock time of a recording, in seconds since 1970."""


class Said(NamedTuple):
    """A message: when it was received, and its fields; those that are left out are zero."""

    time_s: float
    topic: str
    type: str
    fields: Mapping[str, Any]


def store_of(kind: str) -> Any:
    """The types of a format, with those of Gazebo."""
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    states = {
        "gazebo_msgs/msg/ContactState": _STATE,
        STATES: "std_msgs/Header header\ngazebo_msgs/ContactState[] states\n",
        MODELS: "string[] name\ngeometry_msgs/Pose[] pose\n",
        "ros_gz_interfaces/msg/Contact": "float64[] depths\n",
        "ros_gz_interfaces/msg/Contacts": "std_msgs/Header header\nros_gz_interfaces/Contact[] contacts\n",
    }
    if kind == "ros1":
        states[TF] = "geometry_msgs/TransformStamped[] transforms\n"  # a package that not all of ROS 1 has
    types: dict[str, Any] = {}
    for name, text in states.items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


def write_bag(place: Path, kind: str, messages: Iterable[Said], silent: Mapping[str, str] | None = None) -> Path:
    """Writes a bag; returns its file or folder.

    Args:
        place: Where to, without an ending.
        kind: One of `FORMATS`.
        messages: Its messages.
        silent: Topics that are recorded and never heard, with their types.
    """
    store = store_of(kind)
    path = place.with_suffix(".bag") if kind == "ros1" else place
    storage = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer: Any = Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=storage)
    write = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    with writer:
        connections = {topic: writer.add_connection(topic, t, typestore=store) for topic, t in (silent or {}).items()}
        for said in sorted(messages, key=lambda each: each.time_s):
            if said.topic not in connections:
                connections[said.topic] = writer.add_connection(said.topic, said.type, typestore=store)
            raw = write(built(store, said.type, said.fields), said.type)
            writer.write(connections[said.topic], round(said.time_s * 1e9), raw)
    return path


def built(store: Any, name: str, fields: Mapping[str, Any]) -> Any:
    """A message of a type from its fields, inner messages as mappings."""
    return store.types[name](
        **{member: _value(store, what, fields.get(member)) for member, what in store.fielddefs[name][1]}
    )


def _value(store: Any, what: Any, given: Any) -> Any:
    kind, detail = what
    if kind == Nodetype.BASE:
        return given if given is not None else "" if detail[0] == "string" else False if detail[0] == "bool" else 0
    if kind == Nodetype.NAME:
        return built(store, detail, given or {})
    inner, length = detail
    items = given if given is not None else [None] * length
    if inner[0] == Nodetype.BASE and inner[1][0] != "string":
        return np.array([item or 0 for item in items] if given is None else items, dtype=inner[1][0])
    return [_value(store, inner, item) for item in items]


def stamp(time_s: float) -> dict[str, int]:
    """A time."""
    seconds = math.floor(time_s)
    return {"sec": seconds, "nanosec": min(999_999_999, round((time_s - seconds) * 1e9))}


def header(time_s: float, frame: str) -> dict[str, Any]:
    """A header."""
    return {"stamp": stamp(time_s), "frame_id": frame}


def turned(yaw: float) -> dict[str, float]:
    """An orientation."""
    return {"z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def link(time_s: float, parent: str, child: str, pose: Sequence[float]) -> dict[str, Any]:
    """A transform, by x, y and yaw."""
    x, y, yaw = pose
    transform = {"translation": {"x": x, "y": y}, "rotation": turned(yaw)}
    return {"header": header(time_s, parent), "child_frame_id": child, "transform": transform}


def odometry(time_s: float, pose: Sequence[float], topic: str = "/odom") -> Said:
    """A pose in `odom`."""
    x, y, yaw = pose
    where = {"pose": {"position": {"x": x, "y": y}, "orientation": turned(yaw)}}
    return Said(
        time_s, topic, ODOMETRY, {"header": header(time_s, "odom"), "child_frame_id": "base_link", "pose": where}
    )


def mount(time_s: float, x: float = 0.0, frame: str = "base_scan") -> Said:
    """A transform that says where the lidar is."""
    return Said(time_s, "/tf_static", TF, {"transforms": [link(time_s, "base_link", frame, (x, 0.0, 0.0))]})


def scan(
    time_s: float, ranges: Sequence[float] | NDArray[np.floating], frame: str = "base_scan", **fields: Any
) -> Said:
    """A scan all around."""
    usual = {"angle_min": -math.pi, "angle_increment": math.tau / len(ranges), "range_min": 0.1, "range_max": 10.0}
    return Said(time_s, "/scan", SCAN, {"header": header(time_s, frame), **usual, **fields, "ranges": ranges})


def clock(time_s: float, received_s: float) -> Said:
    """A message of `/clock`."""
    return Said(received_s, "/clock", CLOCK, {"clock": stamp(time_s)})


def touch(time_s: float, first: str, second: str, force: float | None) -> Said:
    """A contact in Gazebo, with a force in newtons."""
    wrenches = [] if force is None else [{"force": {"x": force}}]
    state = {
        "collision1_name": first,
        "collision2_name": second,
        "wrenches": wrenches,
        "contact_normals": [{"x": -1.0}],
    }
    return Said(time_s, "/bumper", STATES, {"header": header(time_s, "map"), "states": [state]})


def drive(seconds: float = 12.0, start_s: float = EPOCH_S, wall_x: float = 6.0) -> list[Said]:
    """A robot drives along x at 0.4 m/s, towards a wall that its lidar sees in front of it; all else is 5 m away."""
    found = [mount(start_s, 0.1)]
    for step in range(round(seconds * 20) + 1):
        time_s, x = start_s + step / 20, 0.4 * step / 20
        found.append(odometry(time_s, (x, 0.0, 0.0)))
        if step % 4 == 0:
            ahead = [math.inf] * 360
            ahead[180] = wall_x - (x + 0.1)
            ahead[90] = 5.0
            found.append(scan(time_s, ahead))
    return found


def as_real_robot(recording: Path, seed: int = 1) -> list[Said]:
    """Makes a real robot's recording of a simulated run: with noise, drift, a localisation, and no ground truth.

    Times are of a day in 2025, each message is received a little after its stamp. The odometry drifts; a localisation
    tells ten times a second where `odom` is in the map, to a centimetre; the lidar is noisy. Neither the clock nor
    contacts are there.
    """
    rng = np.random.default_rng(seed)
    found: list[Said] = []
    with AnyReader([recording]) as reader:
        wanted = [each for each in reader.connections if each.topic in ("/odom", "/scan", "/tf_static")]
        due_s = 0.0
        for connection, time_ns, raw in reader.messages(wanted):
            message: Any = reader.deserialize(raw, connection.msgtype)
            sent_s = EPOCH_S + time_ns / 1e9
            received_s = sent_s + 0.005 * float(rng.random())
            if connection.topic == "/tf_static":
                lidars = [each for each in message.transforms if each.child_frame_id == "base_scan"]
                found += [mount(received_s, each.transform.translation.x) for each in lidars]
            elif connection.topic == "/scan":
                ranges = np.asarray(message.ranges)
                noisy = ranges + rng.normal(0, 0.005, len(ranges)).astype(np.float32)
                fields = {
                    name: getattr(message, name) for name in ("angle_min", "angle_increment", "range_min", "range_max")
                }
                found.append(scan(sent_s, noisy, **fields)._replace(time_s=received_s))
            else:
                true = _planar(message.pose.pose)
                drifted = _joined(_drift(time_ns / 1e9), true)
                found.append(odometry(sent_s, drifted)._replace(time_s=received_s))
                transforms = [link(sent_s, "odom", "base_link", drifted)]
                found.append(Said(received_s, "/tf", TF, {"transforms": transforms}))
                if time_ns / 1e9 >= due_s:
                    due_s = time_ns / 1e9 + 0.1
                    seen = [value + float(rng.normal(0, 0.01)) for value in true[:2]]
                    correction = _joined((*seen, true[2]), _inverse(drifted))
                    found.append(Said(received_s, "/tf", TF, {"transforms": [link(sent_s, "map", "odom", correction)]}))
    return found


def _drift(time_s: float) -> tuple[float, float, float]:
    """Two centimetres and half a degree a second: half a metre in half a minute."""
    return 0.02 * time_s, -0.01 * time_s, math.radians(0.5) * time_s


def _planar(pose: Any) -> tuple[float, float, float]:
    q = pose.orientation
    return pose.position.x, pose.position.y, math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def _joined(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


def _inverse(a: Sequence[float]) -> tuple[float, float, float]:
    c, s = math.cos(a[2]), math.sin(a[2])
    return -c * a[0] - s * a[1], s * a[0] - c * a[1], -a[2]
