import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import zstandard
from helpers.examples import examples
from helpers.paths import TESTS
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.states.state_log import (
    CHUNK,
    CHUNK_FRAMES,
    MAGIC,
    StateLog,
    StateLogError,
    StateLogger,
    StateLogWriter,
    checksum,
)

MODEL = """
<mujoco><worldbody>
  <body mocap="true"><geom size=".1" contype="0"/></body>
  <body pos="0 0 1"><freejoint/><geom size=".1" mass="1"/></body>
  <body pos="1 0 .1"><joint type="slide"/><geom size=".1" mass="1"/></body>
  <geom type="plane" size="1 1 .1"/>
</worldbody></mujoco>
"""

LEFT_OPEN: list[StateLogWriter] = []


@pytest.fixture(autouse=True)
def _close_at_last() -> Iterator[None]:
    yield
    while LEFT_OPEN:
        LEFT_OPEN.pop().close()


def physics(text: str = MODEL) -> SimpleNamespace:
    model = mujoco.MjModel.from_xml_string(text)
    return SimpleNamespace(model=model, data=mujoco.MjData(model))


def write(folder: Path, frames: int, *, close: bool = True, seed: int = 0) -> np.ndarray:
    """Logs random states; returns rows of time, positions and mocap."""
    of, rng = physics(), np.random.default_rng(seed)
    writer = StateLogWriter(folder, 10.0, "side")
    rows = []
    for number in range(frames):
        of.data.qpos[:] = rng.normal(size=of.model.nq)
        of.data.mocap_pos[:] = rng.normal(size=(1, 3))
        of.data.mocap_quat[:] = rng.normal(size=(1, 4))
        writer.note(of.model, of.data, number / 10)
        rows.append(np.concatenate([[number / 10], of.data.qpos, of.data.mocap_pos[0], of.data.mocap_quat[0]]))
    if close:
        writer.close()
    else:
        LEFT_OPEN.append(writer)
    return np.array(rows).reshape(frames, -1)


@examples(25)
@given(frames=st.integers(1, 3 * CHUNK_FRAMES), close=st.booleans(), seed=st.integers(0, 99))
def test_what_was_noted_is_read_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, frames: int, close: bool, seed: int
) -> None:
    folder = tmp_path_factory.mktemp("log")
    rows = write(folder, frames, close=close, seed=seed)
    log = StateLog.open(folder)
    assert (log.rate_hz, log.camera, log.frames, log.end_s) == (10.0, "side", frames, rows[-1, 0])
    [segment] = log.segments
    assert np.array_equal(np.column_stack([segment.times, segment.qpos, segment.mocap]), rows)
    segment = StateLog.open(folder).segments[-1]
    times, qpos = segment.times, segment.qpos
    assert np.array_equal(times, rows[:, 0])
    assert np.array_equal(qpos, rows[:, 1:9])


def test_a_state_can_be_put_back(tmp_path: Path) -> None:
    rows = write(tmp_path, 5)
    [segment] = StateLog.open(tmp_path).segments
    model = mujoco.MjModel.from_binary_path(str(segment.model_path))
    data = mujoco.MjData(model)
    segment.set_state(data, 3)
    state = [[data.time], data.qpos, data.mocap_pos.ravel(), data.mocap_quat.ravel()]
    assert np.array_equal(np.concatenate(state), rows[3])


KILLED = """
import os, signal, sys
sys.path += os.environ["TESTS"].split(os.pathsep)
from pathlib import Path
from test_state_log import write
for frames in sys.argv[2:]:
    if (pid := os.fork()) == 0:
        write(Path(sys.argv[1], frames), int(frames), close=False)
        os.kill(os.getpid(), signal.SIGKILL)
    assert os.waitpid(pid, 0)[1] == signal.SIGKILL
"""


def test_a_process_that_is_killed_leaves_every_state(tmp_path: Path) -> None:
    environment = {**os.environ, "TESTS": f"{Path(__file__).parent}{os.pathsep}{TESTS}"}
    numbers = (1, CHUNK_FRAMES, CHUNK_FRAMES + 7)
    for frames in numbers:
        (tmp_path / str(frames)).mkdir()
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path), *map(str, numbers)], env=environment, check=True)
    for frames in numbers:
        assert StateLog.open(tmp_path / str(frames)).frames == frames
        assert np.array_equal(StateLog.open(tmp_path / str(frames)).segments[-1].times, np.arange(frames) / 10)


@pytest.mark.parametrize("keep", [10, 30, 150, 700])
def test_of_a_log_that_is_cut_off_the_whole_chunks_are_read(tmp_path: Path, keep: int) -> None:
    rows = write(tmp_path, 3 * CHUNK_FRAMES)
    states = tmp_path / "states.log"
    data = states.read_bytes()
    states.write_bytes(data[: len(data) * keep // 1000])
    log = StateLog.open(tmp_path)
    assert log.frames % CHUNK_FRAMES == 0
    assert log.frames == 3 * CHUNK_FRAMES * keep // 1000 // CHUNK_FRAMES * CHUNK_FRAMES
    if log.frames:
        assert np.array_equal(log.segments[0].qpos, rows[: log.frames, 1:9])


@examples(30)
@given(place=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255))
def test_of_a_damaged_log_only_what_was_noted_is_read(
    tmp_path_factory: pytest.TempPathFactory, place: float, value: int
) -> None:
    folder = tmp_path_factory.mktemp("log")
    rows = write(folder, 2 * CHUNK_FRAMES)
    data = bytearray((folder / "states.log").read_bytes())
    data[int(place * len(data))] = value
    (folder / "states.log").write_bytes(data)
    read = [row for segment in StateLog.open(folder).segments for row in segment.qpos]
    assert len(read) in (0, CHUNK_FRAMES, 2 * CHUNK_FRAMES)
    assert np.array_equal(np.reshape(read, (-1, 8)), rows[: len(read), 1:9])


@pytest.mark.parametrize("frames", [0, CHUNK_FRAMES, CHUNK_FRAMES + 1, 2**32 - 1])
@pytest.mark.parametrize("packed", [b"", b"no frame", zstandard.compress(bytes(64))[:-3], zstandard.compress(bytes(9))])
def test_a_log_ends_before_what_is_no_chunk(tmp_path: Path, frames: int, packed: bytes) -> None:
    """The checksum is right, as of a chunk that was damaged before it was written."""
    rows = write(tmp_path, CHUNK_FRAMES)
    members = 1, 8, 1, frames, len(packed)
    with (tmp_path / "states.log").open("ab") as file:
        file.write(CHUNK.pack(MAGIC, *members, checksum(members, packed)) + packed)
    assert np.array_equal(StateLog.open(tmp_path).segments[0].qpos, rows[:, 1:9])


def test_there_is_no_log(tmp_path: Path) -> None:
    with pytest.raises(StateLogError, match="not a log of states"):
        StateLog.open(tmp_path / "gone")
    StateLogWriter(tmp_path, 10.0).close()
    assert StateLog.open(tmp_path).segments == []


def test_what_rests_costs_next_to_nothing(tmp_path: Path) -> None:
    bodies = "".join(f"<body pos='{i} 0 1'><freejoint/><geom size='.1'/></body>" for i in range(40))
    of = physics(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    writer = StateLogWriter(tmp_path, 15.0)
    for number in range(600):
        of.data.qpos[0] = np.sin(number)
        writer.note(of.model, of.data, number / 15)
    writer.close()
    per_frame = (tmp_path / "states.log").stat().st_size / 600
    assert per_frame < 40, "281 numbers, of which two change"


def test_an_environment_may_change_its_model(tmp_path: Path) -> None:
    logger = StateLogger(tmp_path, 10)
    smaller = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    for number, text in enumerate((MODEL, smaller)):
        environment = SimpleNamespace(physics=physics(text), video_camera="side")
        for frame in range(4):
            logger.watch(environment, number * 0.4 + frame / 10)
    logger.close("environment")
    log = StateLog.open(tmp_path)
    assert [segment.qpos.shape for segment in log.segments] == [(4, 8), (4, 1)]
    assert [segment.model_path.name for segment in log.segments] == ["model-1.mjb", "model-2.mjb"]
    assert log.camera == "side"


def test_the_rate_is_kept_whatever_the_control_step_is(tmp_path: Path) -> None:
    for step_s, frames in ((0.02, 21), (0.1, 21), (0.25, 9)):
        logger, environment = StateLogger(tmp_path / str(step_s), 10), SimpleNamespace(physics=physics())
        for number in range(round(2 / step_s) + 1):
            if number * step_s >= logger.next_time_s - 5e-7:
                logger.watch(environment, number * step_s)
        logger.close("environment")
        assert StateLog.open(tmp_path / str(step_s)).frames == frames


def test_a_resumed_run_goes_on_with_the_log_of_the_killed_one(tmp_path: Path) -> None:
    rows = write(tmp_path, 100, close=False)
    environment = SimpleNamespace(physics=physics(), video_camera="side")
    logger = StateLogger(tmp_path, 10)
    logger.restore(7.0, environment)
    assert logger.next_time_s == 7.0
    for number in range(70, 80):
        logger.watch(environment, number / 10)
    logger.close("environment")
    segment = StateLog.open(tmp_path).segments[-1]
    times, qpos = segment.times, segment.qpos
    assert np.allclose(times, np.arange(80) / 10)
    assert np.array_equal(qpos[:70], rows[:70, 1:9])
    assert np.array_equal(qpos[70:], np.tile(environment.physics.data.qpos, (10, 1)))


def test_a_log_that_cannot_be_written_fails_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    logger = StateLogger(tmp_path / "file" / "log", 10)
    logger.watch(SimpleNamespace(physics=physics()), 0.0)
    assert logger.next_time_s == float("inf")
    assert "NotADirectoryError" in logger.close("environment").extra["state_log_error"]
    assert "No more states are noted for a video" in capsys.readouterr().err
