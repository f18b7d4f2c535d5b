"""Recordings that are continued by another process are those of an unbroken run, message for message."""

import shutil
from pathlib import Path

import mujoco
import pytest
from helpers.examples import examples
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from mcap.reader import make_reader

from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder, RecordingError
from prefect_robomaker.tasks.runtime.recording.state_series import StateSeries

MODEL = """
<mujoco><worldbody><body>
  <joint name="swing" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>
</body></worldbody></mujoco>
"""


class Drive:
    """Records a pendulum: a message of its own kind now and then besides the series."""

    def __init__(self, recorder: McapRecorder, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.recorder, self.model, self.data = recorder, model, data
        self.series = StateSeries(model, data, [0])
        self.fix("lidar")
        recorder.add_series(self.series)

    def steps(self, count: int) -> None:
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            self.series.sample(self.recorder)
            if round(self.data.time * 500) % 7 == 0:
                self.recorder.write("/tf", ros.TFMessage(()), self.data.time)
                self.fix("camera")  # known from the second time on

    def fix(self, frame: str) -> None:
        header = ros.Header(ros.Time.from_seconds(self.data.time), "base")
        self.recorder.add_static_transforms([ros.TransformStamped(header, frame, ros.Transform())], self.data.time)


def read(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        messages = [(channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()]
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(messages)
    return messages


@pytest.fixture
def model() -> mujoco.MjModel:  # pyright: ignore[reportAttributeAccessIssue]
    return mujoco.MjModel.from_xml_string(MODEL)


@examples(25, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(before=st.integers(0, 60), lost=st.integers(0, 700), after=st.integers(0, 60))
def test_message_for_message(
    tmp_path_factory: pytest.TempPathFactory, model: mujoco.MjModel, before: int, lost: int, after: int
) -> None:
    folder = tmp_path_factory.mktemp("recordings")
    unbroken, data = McapRecorder(folder / "unbroken.mcap"), mujoco.MjData(model)
    drive = Drive(unbroken, model, data)
    drive.steps(before + after)
    unbroken.close()

    broken, data = McapRecorder(folder / "broken.mcap"), mujoco.MjData(model)
    drive = Drive(broken, model, data)
    drive.steps(before)
    state, kept = broken.state(), mujoco.MjData(model)
    mujoco.mj_copyData(kept, model, data)
    drive.steps(lost)
    broken.state()  # on the disk, and still lost: it lies behind the checkpoint

    shutil.copy(folder / "broken.mcap", folder / "resumed.mcap")
    resumed, fresh = McapRecorder(folder / "resumed.mcap", resume=True), mujoco.MjData(model)
    drive = Drive(resumed, model, fresh)
    drive.steps(3)  # what it records before it is put back belongs to another beginning
    mujoco.mj_copyData(fresh, model, kept)
    resumed.restore(state)
    drive.steps(after)
    resumed.close()
    assert read(folder / "resumed.mcap") == read(folder / "unbroken.mcap")


def test_a_recording_that_lost_its_end_is_refused(tmp_path: Path, model: mujoco.MjModel) -> None:
    first = McapRecorder(tmp_path / "a.mcap")
    Drive(first, model, mujoco.MjData(model)).steps(5)
    state = first.state()
    (tmp_path / "a.mcap").write_bytes(b"")
    resumed = McapRecorder(tmp_path / "a.mcap", resume=True)
    with pytest.raises(RecordingError, match=r"it has less than the \d+ bytes that it had at the checkpoint"):
        resumed.restore(state)


@pytest.mark.parametrize("count", [0, 1])
def test_nothing_new_between_two_checkpoints_is_no_error(tmp_path: Path, model: mujoco.MjModel, count: int) -> None:
    recorder = McapRecorder(tmp_path / "a.mcap")
    drive = Drive(recorder, model, mujoco.MjData(model))
    drive.steps(3)
    recorder.state()
    recorder.write("/tf", ros.TFMessage(()), 1.0)
    for _ in range(count):
        recorder.state()
    recorder.close()
    assert len(read(tmp_path / "a.mcap")) > 3
