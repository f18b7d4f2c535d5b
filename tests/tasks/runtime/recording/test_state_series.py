"""State sampled from real physics against the same state written down message by message."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from prefect_robomaker.tasks.runtime.recording.cdr import RowEncoder
from prefect_robomaker.tasks.runtime.recording.mcap_file import RECORD_HEAD_BYTES
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder, Recorder
from prefect_robomaker.tasks.runtime.recording.state_series import StateSeries, hinges_and_slides

MODEL = """
<mujoco>
  <option gravity="0 0 0"/><worldbody>
    <body pos="5 0 1"><freejoint/><geom size=".1"/></body>
    <body pos="0 0 1">
      <freejoint name="base"/><geom size=".1 .2 .3" type="box"/>
      <body><joint name="arm" type="hinge" axis="0 1 0" pos=".3 0 0"/><geom size=".1" pos=".3 0 0"/></body>
      <body><joint name="ball" type="ball"/><geom size=".05" pos="0 0 .3"/></body>
      <body><joint type="slide" axis="1 0 0"/><geom size=".1" pos="-.3 0 0"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="arm"/></actuator>
</mujoco>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


def tumble(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    base = model.joint("base").dofadr[0]
    data.qvel[base : base + 6] = (0.5, -0.3, 1.0, 2.0, -3.0, 1.0)
    data.ctrl[0] = 0.01
    mujoco.mj_forward(model, data)
    return data


def read(path: Path) -> dict[str, list]:
    messages: dict[str, list] = {}
    with path.open("rb") as stream:
        for item in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            messages.setdefault(item.channel.topic, []).append((item.message.log_time, item.decoded_message))
    return messages


def test_what_is_published_is_the_state(model: mujoco.MjModel, tmp_path: Path) -> None:
    data = tumble(model)
    base = model.joint("base").id
    joints = hinges_and_slides(model).tolist()
    states = []
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        series = StateSeries(model, data, joints, base=[base], joint_frame="base_link")
        recorder.add_series(series)
        for _ in range(700):  # more than a series holds
            states.append((data.time, data.qpos.copy(), data.qvel.copy(), data.qfrc_actuator.copy()))
            series.sample(recorder)
            mujoco.mj_step(model, data)
    found = read(tmp_path / "r.mcap")
    assert set(found) == {"/clock", "/tf", "/odom", "/joint_states"}
    assert [time_ns for time_ns, _ in found["/odom"]] == [round(time_s * 1e9) for time_s, *_ in states]
    position, rate = int(model.joint("base").qposadr[0]), int(model.joint("base").dofadr[0])
    matrix = np.zeros(9)
    for row, (time_s, qpos, qvel, force) in enumerate(states):
        clock = found["/clock"][row][1].clock
        assert clock.sec * 10**9 + clock.nanosec == round(time_s * 1e9)
        pose, twist = found["/odom"][row][1].pose.pose, found["/odom"][row][1].twist.twist
        turn = pose.orientation
        assert [pose.position.x, pose.position.y, pose.position.z] == qpos[position : position + 3].tolist()
        assert [turn.w, turn.x, turn.y, turn.z] == qpos[position + 3 : position + 7].tolist()
        moved = found["/tf"][row][1].transforms[0].transform
        assert (moved.translation.z, moved.rotation.w) == (pose.position.z, turn.w)
        mujoco.mju_quat2Mat(matrix, qpos[position + 3 : position + 7])
        ahead = matrix.reshape(3, 3).T @ qvel[rate : rate + 3]
        np.testing.assert_allclose([twist.linear.x, twist.linear.y, twist.linear.z], ahead, atol=1e-12)
        assert [twist.angular.x, twist.angular.y, twist.angular.z] == qvel[rate + 3 : rate + 6].tolist()
        joint = found["/joint_states"][row][1]
        assert joint.name == ["arm", f"joint_{joints[1]}"]
        assert list(joint.position) == qpos[model.jnt_qposadr[joints]].tolist()
        assert list(joint.velocity) == qvel[model.jnt_dofadr[joints]].tolist()
        assert list(joint.effort) == force[model.jnt_dofadr[joints]].tolist()
    assert states[0][3].any()


def test_a_base_on_slides_moves_over_the_floor(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body>
      <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <joint name="turn" type="hinge" axis="0 0 1"/><geom size="1"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[:] = 1.0, 2.0, np.pi / 2
    data.qvel[:] = 0.25, 0.5, 0.75
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        series = StateSeries(model, data, [], base=[model.joint(name).id for name in ("x", "y", "turn")])
        recorder.add_series(series)
        series.sample(recorder)
    [(_, message)] = read(tmp_path / "r.mcap")["/odom"]
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    assert (place.x, place.y, place.z, turn.x, turn.y) == (1.0, 2.0, 0.0, 0.0, 0.0)
    assert (turn.z, turn.w) == pytest.approx((np.sqrt(0.5), np.sqrt(0.5)))
    twist = message.twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == pytest.approx((0.5, -0.25, 0.75))


def test_a_fixed_thing_without_joints_has_a_clock(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        series = StateSeries(model, data, hinges_and_slides(model).tolist())
        recorder.add_series(series)
        series.sample(recorder)
    assert {topic: len(messages) for topic, messages in read(tmp_path / "r.mcap").items()} == {"/clock": 1}


def test_sampling_changes_nothing(model: mujoco.MjModel, tmp_path: Path) -> None:
    recorded, alone = tumble(model), tumble(model)
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        series = StateSeries(model, recorded, hinges_and_slides(model).tolist(), base=[model.joint("base").id])
        recorder.add_series(series)
        for _ in range(100):
            series.sample(recorder)
            mujoco.mj_step(model, recorded, 10)
    for _ in range(100):
        mujoco.mj_step(model, alone, 10)
    np.testing.assert_array_equal(recorded.qpos, alone.qpos)
    np.testing.assert_array_equal(recorded.qvel, alone.qvel)


def test_one_state_has_the_very_numbers_of_its_row(model: mujoco.MjModel) -> None:
    data = tumble(model)
    base = [model.joint("base").id]
    series = StateSeries(model, data, hinges_and_slides(model).tolist(), base=base)
    topics = [topic for topic, _ in series.topics]
    encoder = RowEncoder([(number, columns) for number, (_, columns) in enumerate(series.topics)])
    for _ in range(50):
        mujoco.mj_step(model, data)
        series.sample(Recorder())
        row = encoder.encode(*series.take())
        time_s, values = series.present(topics)
        for number, message in enumerate(encoder.encode_one(time_s, values, range(len(topics)))):
            start = row.starts[number] + RECORD_HEAD_BYTES
            assert bytes(row.records[start : start + len(message)]) == message, topics[number]
    assert series.present({"/clock"}) == (data.time, [[], [], [], []])
