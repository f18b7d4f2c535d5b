"""Our bytes against those of rosbags' own messages, and as `mcap-ros2-support` reads them, which shares no code."""

from typing import Any

import numpy as np
import pytest
from helpers.examples import examples
from helpers.second_decoder import assert_decodes_to
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.cdr import definition, encode

STORE = get_typestore(Stores.ROS2_HUMBLE)

some = examples(50)

numbers = st.floats(allow_nan=False)
small = st.floats(width=32, allow_nan=False)
texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
headers = st.builds(ros.Header, st.builds(ros.Time, st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1)), texts)
vectors = st.builds(ros.Vector3, numbers, numbers, numbers)
quaternions = st.builds(ros.Quaternion, numbers, numbers, numbers, numbers)
poses = st.builds(ros.Pose, vectors, quaternions)
twists = st.builds(ros.Twist, vectors, vectors)


def covariances(length: int) -> st.SearchStrategy[Any]:
    zeros = ros.NO_COVARIANCE if length == 36 else ros.NO_COVARIANCE_3X3
    return st.just(zeros) | st.lists(numbers, min_size=length, max_size=length)


def theirs(kind: str, **members: Any) -> Any:
    return STORE.types[kind](**members)


def header_of(header: ros.Header) -> Any:
    stamp = theirs("builtin_interfaces/msg/Time", sec=header.stamp.sec, nanosec=header.stamp.nanosec)
    return theirs("std_msgs/msg/Header", stamp=stamp, frame_id=header.frame_id)


def vector_of(vector: ros.Vector3, kind: str = "Vector3") -> Any:
    return theirs(f"geometry_msgs/msg/{kind}", **vector._asdict())


def quaternion_of(quaternion: ros.Quaternion) -> Any:
    return theirs("geometry_msgs/msg/Quaternion", **quaternion._asdict())


def expected(kind: type[ros.Message], message: Any) -> bytes:
    data = bytes(STORE.serialize_cdr(message, kind.ROS_TYPE))
    assert_decodes_to(data, kind.ROS_TYPE, definition(kind.ROS_TYPE), message)
    return data


@some
@given(headers)
def test_clock(header: ros.Header) -> None:
    stamp = header_of(header).stamp
    assert encode(ros.Clock(header.stamp)) == expected(ros.Clock, theirs("rosgraph_msgs/msg/Clock", clock=stamp))


@some
@given(
    st.lists(
        st.builds(ros.TransformStamped, headers, texts, st.builds(ros.Transform, vectors, quaternions)), max_size=4
    )
)
def test_transforms(transforms: list[ros.TransformStamped]) -> None:
    message = theirs(
        "tf2_msgs/msg/TFMessage",
        transforms=[
            theirs(
                "geometry_msgs/msg/TransformStamped",
                header=header_of(item.header),
                child_frame_id=item.child_frame_id,
                transform=theirs(
                    "geometry_msgs/msg/Transform",
                    translation=vector_of(item.transform.translation),
                    rotation=quaternion_of(item.transform.rotation),
                ),
            )
            for item in transforms
        ],
    )
    assert encode(ros.TFMessage(transforms)) == expected(ros.TFMessage, message)


@some
@given(headers, texts, poses, twists, covariances(36), covariances(36))
def test_odometry(header, child, pose, twist, pose_covariance, twist_covariance) -> None:
    message = theirs(
        "nav_msgs/msg/Odometry",
        header=header_of(header),
        child_frame_id=child,
        pose=theirs(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=theirs(
                "geometry_msgs/msg/Pose",
                position=vector_of(pose.position, "Point"),
                orientation=quaternion_of(pose.orientation),
            ),
            covariance=np.array(pose_covariance),
        ),
        twist=theirs(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=theirs("geometry_msgs/msg/Twist", linear=vector_of(twist.linear), angular=vector_of(twist.angular)),
            covariance=np.array(twist_covariance),
        ),
    )
    ours = ros.Odometry(header, child, pose, twist, pose_covariance, twist_covariance)
    assert encode(ours) == expected(ros.Odometry, message)


@some
@given(headers, st.lists(small, min_size=7, max_size=7), st.lists(small, max_size=9), st.lists(small, max_size=3))
def test_laser_scan(header, values, ranges, intensities) -> None:
    arrays = np.array(ranges, dtype=np.float32), np.array(intensities, dtype=np.float32)
    angles_and_ranges: Any = [*values, *arrays]
    ours = ros.LaserScan(header, *angles_and_ranges)
    members = {**ours._asdict(), "header": header_of(header)}
    assert encode(ours) == expected(ros.LaserScan, theirs("sensor_msgs/msg/LaserScan", **members))


@some
@given(headers, st.lists(texts, max_size=4), *[st.lists(numbers, max_size=4)] * 3)
def test_joint_state(header, names, position, velocity, effort) -> None:
    ours = ros.JointState(header, names, np.array(position), velocity, effort)
    message = theirs(
        "sensor_msgs/msg/JointState",
        header=header_of(header),
        name=names,
        position=np.array(position),
        velocity=np.array(velocity),
        effort=np.array(effort),
    )
    assert encode(ours) == expected(ros.JointState, message)


@some
@given(headers, quaternions, vectors, vectors, st.tuples(*[covariances(9)] * 3))
def test_imu(header, orientation, rates, acceleration, three) -> None:
    names = [f"{name}_covariance" for name in ("orientation", "angular_velocity", "linear_acceleration")]
    message = theirs(
        "sensor_msgs/msg/Imu",
        header=header_of(header),
        orientation=quaternion_of(orientation),
        angular_velocity=vector_of(rates),
        linear_acceleration=vector_of(acceleration),
        **{name: np.array(values) for name, values in zip(names, three, strict=True)},
    )
    assert encode(ros.Imu(header, orientation, rates, acceleration, *three)) == expected(ros.Imu, message)


def test_views_of_arrays_are_encoded_as_their_numbers() -> None:
    header, some = ros.Header(ros.Time(1, 2), "laser"), np.arange(72.0)
    for make in (
        lambda view: ros.LaserScan(header, 0.0, 1.0, 0.1, 0.0, 0.1, 0.1, 9.0, view(some), view(some)),
        lambda view: ros.JointState(header, ["a"], view(some), view(some), view(some)),
        lambda view: ros.Odometry(header, "base_link", ros.Pose(), ros.Twist(), view(some)),
        lambda view: ros.Odometry(header, "base_link", ros.Pose(), ros.Twist(), view(some).reshape(6, 6).T),
    ):
        assert encode(make(lambda array: array[::-2])) == encode(make(lambda array: array[::-2].copy()))


def test_other_objects_are_refused_by_name() -> None:
    with pytest.raises(TypeError, match="cannot encode str; the messages that can be recorded are Clock, TFMessage"):
        encode("hello")  # pyright: ignore[reportArgumentType]


def test_parts_without_their_members_are_refused() -> None:
    pose = ros.Pose((1.0, 2.0, 0.0))  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="cannot encode Odometry: 'tuple' object has no attribute 'x'"):
        encode(ros.Odometry(ros.Header(ros.Time(0, 0), "odom"), "base_link", pose, ros.Twist()))


def test_covariances_of_wrong_length_are_refused() -> None:
    header = ros.Header(ros.Time(0, 0), "odom")
    with pytest.raises(ValueError, match="36 numbers is needed, not 3"):
        encode(ros.Odometry(header, "base_link", ros.Pose(), ros.Twist(), [1.0, 2.0, 3.0]))


@given(st.floats(-1e6, 1e6))
def test_times_are_to_the_nanosecond(time_s: float) -> None:
    time = ros.Time.from_seconds(time_s)
    assert 0 <= time.nanosec < 1_000_000_000
    assert time.sec + time.nanosec * 1e-9 == pytest.approx(time_s, abs=1e-9)


@pytest.mark.parametrize("kind", [ros.Clock, ros.TFMessage, ros.Odometry, ros.LaserScan, ros.JointState, ros.Imu])
def test_definitions_mean_what_ros_means(kind: type[ros.Message]) -> None:
    from rosbags.typesys import get_types_from_msg

    parsed = get_types_from_msg(definition(kind.ROS_TYPE), kind.ROS_TYPE)
    for name, fields in parsed.items():
        assert fields == STORE.fielddefs[name], name
