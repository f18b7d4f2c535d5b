"""Messages encoded many at once against the same messages encoded one by one, by us and by rosbags."""

from typing import Any

import numpy as np
import pytest
from helpers.examples import examples
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.typesys import Stores, get_typestore

from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.cdr import RowEncoder, clock, encode, joint_states, odometry, transforms
from prefect_robomaker.tasks.runtime.recording.mcap_file import message_record

STORE = get_typestore(Stores.ROS2_HUMBLE)

names = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
numbers = st.floats(allow_nan=False)
times = st.floats(0, 2**31 - 1).map(lambda time_s: round(time_s, 4))


@st.composite
def states(draw: st.DrawFn) -> tuple[Any, ...]:
    count = draw(st.integers(1, 4))
    joints = draw(st.lists(names, min_size=1, max_size=4))
    widths = 7, 6, len(joints), len(joints), len(joints)
    values = [draw(arrays(np.float64, (count, width), elements=numbers)) for width in widths]
    return (
        np.array(sorted(draw(st.lists(times, min_size=count, max_size=count)))),
        draw(names),
        draw(names),
        joints,
        *values,
    )


def message_by_message(time_s, parent, child, joints, pose, twist, *triple) -> list[ros.Message]:
    stamp = ros.Time.from_seconds(float(time_s))
    header = ros.Header(stamp, parent)
    position, rotation = ros.Vector3(*pose[:3].tolist()), ros.Quaternion(*pose[3:].tolist())
    motion = ros.Twist(ros.Vector3(*twist[:3].tolist()), ros.Vector3(*twist[3:].tolist()))
    return [
        ros.Clock(stamp),
        ros.TFMessage([ros.TransformStamped(header, child, ros.Transform(position, rotation))]),
        ros.Odometry(header, child, ros.Pose(position, rotation), motion),
        ros.JointState(ros.Header(stamp, child), joints, *[values.tolist() for values in triple]),
    ]


@examples(40)
@given(states())
def test_rows_are_the_messages_one_by_one(state) -> None:
    times_s, parent, child, joints, pose, twist, *triple = state
    columns = [clock(), transforms([(parent, child)]), odometry(parent, child), joint_states(child, joints)]
    encoder = RowEncoder([(channel + 3, item) for channel, item in enumerate(columns)])
    rows = encoder.encode(times_s, [[], [pose], [pose, twist], triple])
    expected = b""
    for row, time_s in enumerate(times_s):
        one = message_by_message(time_s, parent, child, joints, pose[row], twist[row], *[item[row] for item in triple])
        time_ns = round(float(time_s) * 10**9)
        assert rows.times_ns[row] == time_ns
        for channel, (item, message) in enumerate(zip(columns, one, strict=True)):
            assert item.kind is type(message)
            expected += message_record(channel + 3, time_ns, encode(message))
    assert rows.records == expected


@examples(40)
@given(states(), names)
def test_several_transforms_in_a_message_have_their_stamps_and_numbers(state, other: str) -> None:
    times_s, parent, child, _, pose, *_ = state
    assume(other != child)
    encoder = RowEncoder([(3, transforms([(parent, child), (child, other)]))])
    rows = encoder.encode(times_s, [[pose, -pose]])
    expected = b""
    for row, time_s in enumerate(times_s):
        stamp = ros.Time.from_seconds(float(time_s))
        items = [
            ros.TransformStamped(
                ros.Header(stamp, frame), of, ros.Transform(ros.Vector3(*item[:3]), ros.Quaternion(*item[3:]))
            )
            for frame, of, item in ((parent, child, pose[row].tolist()), (child, other, (-pose[row]).tolist()))
        ]
        expected += message_record(3, round(float(time_s) * 10**9), encode(ros.TFMessage(items)))
    assert rows.records == expected


@examples(40)
@given(states())
def test_rosbags_reads_the_numbers_and_writes_the_same_bytes(state) -> None:
    times_s, parent, child, joints, pose, twist, *triple = state
    columns = [transforms([(parent, child)]), odometry(parent, child), joint_states(child, joints)]
    rows = RowEncoder([*enumerate(columns)]).encode(times_s, [[pose], [pose, twist], triple])
    size = len(rows.records) // len(times_s)
    last = rows.records[-size:]
    ends = [*list(rows.starts.values())[1:], size]
    found = []
    for column, start, end in zip(columns, rows.starts.values(), ends, strict=True):
        raw = last[start + 31 : end]
        message = STORE.deserialize_cdr(raw, column.kind.ROS_TYPE)
        assert bytes(STORE.serialize_cdr(message, column.kind.ROS_TYPE)) == raw
        found.append(message)
    moved, motion, joint = found
    assert moved.transforms[0].transform.rotation.w == pose[-1, 6]
    assert (moved.transforms[0].header.frame_id, moved.transforms[0].child_frame_id) == (parent, child)
    assert (motion.pose.pose.position.x, motion.twist.twist.angular.z) == (pose[-1, 0], twist[-1, 5])
    assert joint.name == joints
    np.testing.assert_array_equal([joint.position, joint.velocity, joint.effort], [item[-1] for item in triple])


def test_joint_states_need_joints() -> None:
    with pytest.raises(ValueError, match="at least one joint"):
        joint_states("base_link", [])
