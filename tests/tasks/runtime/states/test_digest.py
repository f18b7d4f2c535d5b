"""The digest of states: equal for equal runs, and what differs can be found and named."""

# pyright: reportAttributeAccessIssue=false

import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest
import zstandard
from helpers.examples import examples
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.provenance import StateDigestSummary
from prefect_robomaker.tasks.runtime.states.digest import StateDigest, digest_of_model, read_timeline

MODEL = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/>
      <body name="hand" pos=".4 0 0"><joint axis="0 1 0"/><geom size=".1" pos=".2 0 0"/></body>
    </body>
    <body name="ball" pos="0 0 3"><freejoint/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor joint="shoulder"/></actuator>
</mujoco>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


def run(model: mujoco.MjModel, path: Path, steps: int = 300, nudge_at: int = -1) -> StateDigestSummary:
    digest, data = StateDigest(path), mujoco.MjData(model)
    for step in range(steps):
        if step % 20 == 0:
            digest.look(model, data)
        data.ctrl[0] = np.sin(step)
        if step == nudge_at:
            data.qpos[1] = np.nextafter(data.qpos[1], 1.0)
        mujoco.mj_step(model, data)
    summary = digest.finish(data)
    assert summary is not None
    return summary


def test_equal_runs_have_equal_digests(model: mujoco.MjModel, tmp_path: Path) -> None:
    first, again = run(model, tmp_path / "1"), run(model, tmp_path / "2")
    assert first == again
    assert (first.looks, first.until_s) == (16, pytest.approx(3.0))
    assert (tmp_path / "1").read_bytes() == (tmp_path / "2").read_bytes()


def test_one_bit_of_one_joint_shows_from_the_next_link_on(model: mujoco.MjModel, tmp_path: Path) -> None:
    assert run(model, tmp_path / "1").value != run(model, tmp_path / "2", nudge_at=130).value
    one, other = read_timeline(tmp_path / "1"), read_timeline(tmp_path / "2")
    same = [a == b for a, b in zip(one.links, other.links, strict=True)]
    assert same == [True] * 7 + [False] * 9
    np.testing.assert_array_equal(one.times_s, other.times_s)
    np.testing.assert_allclose(one.times_s, [*np.arange(15) * 0.2, 3.0])


def test_states_are_kept_once_a_second_and_at_the_end(model: mujoco.MjModel, tmp_path: Path) -> None:
    run(model, tmp_path / "1", steps=250)
    states = read_timeline(tmp_path / "1").states
    assert [len(state) for state in states] == [1 + model.nq + model.nv] * 4
    np.testing.assert_allclose([state[0] for state in states], [0.0, 1.0, 2.0, 2.5])


@examples(20, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(cut=st.integers(0, 400), steps=st.integers(1, 4000))
def test_a_file_cut_off_anywhere_gives_its_whole_blocks(
    model: mujoco.MjModel, tmp_path: Path, cut: int, steps: int
) -> None:
    path = tmp_path / "cut"
    run(model, path, steps)
    whole, content = read_timeline(path), path.read_bytes()
    path.write_bytes(content[: max(len(content) - cut, 19)])
    timeline = read_timeline(path)
    assert timeline.links == whole.links[: len(timeline.links)]
    assert len(timeline.links) == len(timeline.times_s)


def test_continuing_gives_the_same_digest_and_file(model: mujoco.MjModel, tmp_path: Path) -> None:
    def drive(digest: StateDigest, data: mujoco.MjData, steps: int) -> None:
        for _ in range(steps):
            mujoco.mj_step(model, data, 20)
            digest.look(model, data)

    unbroken, data = StateDigest(tmp_path / "1"), mujoco.MjData(model)
    drive(unbroken, data, 6)
    unbroken.state()
    drive(unbroken, data, 6)
    broken, data = StateDigest(tmp_path / "2"), mujoco.MjData(model)
    drive(broken, data, 6)
    state, kept = broken.state(), mujoco.MjData(model)
    mujoco.mj_copyData(kept, model, data)
    drive(broken, data, 3)
    broken.state()  # written after the checkpoint, so lost with it
    resumed = StateDigest(tmp_path / "2")
    resumed.restore(state, model)
    drive(resumed, kept, 6)
    assert resumed.finish(kept) == unbroken.finish()
    assert (tmp_path / "1").read_bytes() == (tmp_path / "2").read_bytes()


def test_a_model_is_the_same_wherever_its_files_lie(tmp_path: Path) -> None:
    def digest_in(folder: Path, size: str) -> str:
        folder.mkdir()
        corners = ("0 0 0", f"{size} 0 0", "0 1 0", "0 0 1")
        (folder / "block.obj").write_text(
            "".join(f"v {corner}\n" for corner in corners) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
        )
        (folder / "world.xml").write_text(
            '<mujoco><asset><mesh file="block.obj"/></asset>'
            '<worldbody><geom type="mesh" mesh="block"/></worldbody></mujoco>'
        )
        return digest_of_model(mujoco.MjModel.from_xml_path(str(folder / "world.xml")))

    first, moved, other = (
        digest_in(tmp_path / "1", "1"),
        digest_in(tmp_path / "moved", "1"),
        digest_in(tmp_path / "3", "2"),
    )
    assert first == moved
    assert first != other


def test_every_number_of_a_model_counts(model: mujoco.MjModel) -> None:
    digests = [digest_of_model(model)]
    for array in (model.opt.gravity, model.vis.rgba.fog, model.stat.center, model.geom_size[0], model.body_mass):
        array[-1] = np.nextafter(array[-1], 9)
        digests.append(digest_of_model(model))
    model.opt.timestep = 0.02
    assert len({*digests, digest_of_model(model)}) == 7


def test_another_model_on_the_way_counts(model: mujoco.MjModel, tmp_path: Path) -> None:
    heavier = mujoco.MjModel.from_xml_string(MODEL.replace('size=".1"/></body>\n  </w', 'size=".11"/></body>\n  </w'))
    assert digest_of_model(model) != digest_of_model(heavier)
    values = []
    for second in (model, heavier):
        digest = StateDigest(tmp_path / "models")
        digest.look(model, mujoco.MjData(model))
        digest.look(second, mujoco.MjData(second))
        values.append(digest.finish())
    assert values[0] != values[1]


def test_without_a_state_there_is_neither_digest_nor_file(tmp_path: Path) -> None:
    assert StateDigest(tmp_path / "none").finish() is None
    assert list(tmp_path.iterdir()) == []


def test_another_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("hello")
    with pytest.raises(ValueError, match="x is no digest of a run"):
        read_timeline(tmp_path / "x")


@pytest.mark.parametrize("packed", [b"no frame at all", zstandard.compress(bytes(1 << 20))])
def test_a_damaged_file_is_said_to_be_damaged(tmp_path: Path, packed: bytes) -> None:
    path = tmp_path / "digest.bin"
    path.write_bytes(b"robomaker digest 1\n" + struct.pack("<IIII", len(packed), 1, 0, 0) + packed)
    with pytest.raises(ValueError, match="is damaged at byte 35"):
        read_timeline(path)


def test_given_states_are_linked_and_not_kept(tmp_path: Path) -> None:
    digest = StateDigest(tmp_path / "given")
    for step in range(7000):  # more than two blocks
        digest.look_at(step.to_bytes(2, "big"), step / 100)
    summary = digest.finish()
    timeline = read_timeline(tmp_path / "given")

    assert summary is not None
    assert (summary.looks, summary.until_s) == (7000, pytest.approx(69.99))
    assert len(set(timeline.links)) == 7000
    np.testing.assert_allclose(timeline.times_s, np.arange(7000) / 100)
    assert timeline.states == []
    alone = StateDigest(None)
    for step in range(7000):
        alone.look_at(step.to_bytes(2, "big"), step / 100)
    assert alone.finish() == summary


def test_each_given_byte_and_the_order_count() -> None:
    def of(*states: bytes) -> str:
        digest = StateDigest(None)
        for state in states:
            digest.look_at(state, 0.0)
        summary = digest.finish()
        assert summary is not None
        return summary.value

    assert len({of(b"a", b"b"), of(b"b", b"a"), of(b"ab"), of(b"a"), of(b"", b"ab"), of(b"a", b"b", b"")}) == 6
