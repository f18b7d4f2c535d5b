"""Our bytes against those of rosbags' own messages, and as `mcap-ros2-support` reads them, which shares no code."""

from typing import Any

import numpy as np
import pytest
from helpers.examples import examples
from helpers.second_decoder import assert_decodes_to
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from prefect_robomaker.tasks.runtime.recording import messages as display
from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.cdr import Message, definition, encode, type_hash

STORES = [get_typestore(store) for store in (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY, Stores.ROS2_KILTED)]
STORE = STORES[0]
KINDS: list[type[Message]] = [
    ros.Clock, ros.TFMessage, ros.Odometry, ros.LaserScan, ros.JointState, ros.Imu,
    display.PoseStamped, display.Path, display.CompressedImage, display.CameraInfo, display.OccupancyGrid,
    display.MarkerArray,
]  # fmt: skip

some = examples(50)

numbers = st.floats(allow_nan=False)
small = st.floats(width=32, allow_nan=False)
texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
times = st.builds(ros.Time, st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
headers = st.builds(ros.Header, times, texts)
vectors = st.builds(ros.Vector3, numbers, numbers, numbers)
poses = st.builds(ros.Pose, vectors, st.builds(ros.Quaternion, numbers, numbers, numbers, numbers))
stamped = st.builds(display.PoseStamped, headers, poses)
markers = st.builds(
    display.Marker, headers, texts, st.integers(-(2**31), 2**31 - 1), st.sampled_from(display.MarkerType), poses,
    vectors, st.builds(display.ColorRGBA, small, small, small, small), times, st.lists(vectors, max_size=3), texts,
    st.booleans(),
)  # fmt: skip


def theirs(kind: str, **members: Any) -> Any:
    return STORE.types[kind](**members)


def header_of(header: ros.Header) -> Any:
    stamp = theirs("builtin_interfaces/msg/Time", **header.stamp._asdict())
    return theirs("std_msgs/msg/Header", stamp=stamp, frame_id=header.frame_id)


def pose_of(pose: ros.Pose) -> Any:
    return theirs(
        "geometry_msgs/msg/Pose",
        position=theirs("geometry_msgs/msg/Point", **pose.position._asdict()),
        orientation=theirs("geometry_msgs/msg/Quaternion", **pose.orientation._asdict()),
    )


def stamped_of(pose: display.PoseStamped) -> Any:
    return theirs("geometry_msgs/msg/PoseStamped", header=header_of(pose.header), pose=pose_of(pose.pose))


def image(header: ros.Header, kind: str, data: bytes) -> Any:
    array = np.frombuffer(data, np.uint8)
    return theirs("sensor_msgs/msg/CompressedImage", header=header_of(header), format=kind, data=array)


def marker_of(marker: display.Marker) -> Any:
    nothing = np.zeros(0, np.uint8)
    return theirs(
        "visualization_msgs/msg/Marker",
        header=header_of(marker.header), ns=marker.ns, id=marker.id, type=int(marker.type), action=0,
        pose=pose_of(marker.pose), scale=theirs("geometry_msgs/msg/Vector3", **marker.scale._asdict()),
        color=theirs("std_msgs/msg/ColorRGBA", **marker.color._asdict()),
        lifetime=theirs("builtin_interfaces/msg/Duration", **marker.lifetime._asdict()),
        frame_locked=marker.frame_locked,
        points=[theirs("geometry_msgs/msg/Point", **point._asdict()) for point in marker.points], colors=[],
        texture_resource="", texture=image(ros.Header(ros.Time(0, 0), ""), "", b""), uv_coordinates=[],
        text=marker.text, mesh_resource="",
        mesh_file=theirs("visualization_msgs/msg/MeshFile", filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )  # fmt: skip


def check(ours: Any, message: Any) -> None:
    kind = type(ours).ROS_TYPE
    data = encode(ours)
    assert data == bytes(STORE.serialize_cdr(message, kind))
    assert_decodes_to(data, kind, definition(kind), message)


@some
@given(stamped)
def test_pose(ours: display.PoseStamped) -> None:
    check(ours, stamped_of(ours))


@some
@given(headers, st.lists(stamped, max_size=4))
def test_path(header: ros.Header, way: list[display.PoseStamped]) -> None:
    message = theirs("nav_msgs/msg/Path", header=header_of(header), poses=[stamped_of(pose) for pose in way])
    check(display.Path(header, way), message)


@some
@given(headers, texts, st.binary(max_size=40))
def test_compressed_image(header: ros.Header, kind: str, data: bytes) -> None:
    check(display.CompressedImage(header, kind, data), image(header, kind, data))


sizes = st.integers(0, 2**32 - 1)


@some
@given(st.builds(display.CameraInfo, headers, sizes, sizes, numbers, numbers, numbers, numbers))
def test_camera_info(ours: display.CameraInfo) -> None:
    _, height, width, fx, fy, cx, cy = ours
    roi = theirs("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    message = theirs(
        "sensor_msgs/msg/CameraInfo",
        header=header_of(ours.header), height=height, width=width, distortion_model="plumb_bob", d=np.zeros(5),
        k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1]), r=np.eye(3).ravel(),
        p=np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]), binning_x=0, binning_y=0, roi=roi,
    )  # fmt: skip
    check(ours, message)


@some
@given(st.builds(display.OccupancyGrid, headers, small, sizes, sizes, poses, st.binary(max_size=40)))
def test_occupancy_grid(ours: display.OccupancyGrid) -> None:
    header, resolution, width, height, origin, data = ours
    info = theirs(
        "nav_msgs/msg/MapMetaData", map_load_time=header_of(header).stamp, resolution=resolution, width=width,
        height=height, origin=pose_of(origin),
    )  # fmt: skip
    cells = np.frombuffer(data, np.int8)
    check(ours, theirs("nav_msgs/msg/OccupancyGrid", header=header_of(header), info=info, data=cells))


@some
@given(st.lists(markers, max_size=3))
def test_markers(ours: list[display.Marker]) -> None:
    message = theirs("visualization_msgs/msg/MarkerArray", markers=[marker_of(marker) for marker in ours])
    check(display.MarkerArray(ours), message)


@pytest.mark.parametrize("kind", KINDS)
def test_definitions_and_hashes_are_those_of_ros(kind: type[Message]) -> None:
    parsed = get_types_from_msg(definition(kind.ROS_TYPE), kind.ROS_TYPE)
    for store in STORES:
        assert store.hash_rihs01(kind.ROS_TYPE) == type_hash(kind.ROS_TYPE)
        for name, (constants, fields) in parsed.items():
            # Later distributions have more kinds of markers.
            assert fields == store.fielddefs[name][1], name
            assert set(constants) <= set(store.fielddefs[name][0]), name
