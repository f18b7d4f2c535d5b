"""Logs of actions: what a robot did is read as it was, however the process that wrote it ended."""

import hashlib
import json
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from dm_env import specs
from helpers.examples import examples
from helpers.paths import TESTS
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.provenance import ActionsSummary
from prefect_robomaker.tasks.runtime.agents import action_log
from prefect_robomaker.tasks.runtime.agents.action_log import (
    CHUNK_ACTIONS,
    CHUNK_BYTES,
    PACKED,
    ActionLog,
    ActionLogError,
    ActionLogHeader,
    ActionLogWriter,
    ActionRecorder,
    chunk_of,
    header_of,
)
from prefect_robomaker.tasks.runtime.agents.agent_client import ACTION_HEADER
from prefect_robomaker.tasks.runtime.agents.agent_layout import Layout

WHEELS = header_of("lockstep", Layout(specs.Array((2,), np.float64), ACTION_HEADER.size))


def some_actions(count: int, size: int, seed: int = 0) -> list[bytes]:
    """Actions of which some are held for a while."""
    rng = np.random.default_rng(seed)
    actions: list[bytes] = []
    for _ in range(count):
        actions.append(actions[-1] if actions and rng.random() < 0.5 else rng.bytes(size))
    return actions


def write(
    path: Path, actions: list[bytes], header: ActionLogHeader = WHEELS, *, close: bool = True
) -> ActionsSummary | None:
    writer = ActionLogWriter(path, header)
    for action in actions:
        writer.add(action)
    if close:
        return writer.close()
    writer.abandon()
    return None


def header_line(arrays: list[Any]) -> bytes:
    """What a log begins with."""
    header = {"mode": "lockstep", "size": 16, "arrays": arrays}
    return b"robomaker actions 1\n" + json.dumps(header).encode() + b"\n"


@examples(30)
@given(
    count=st.one_of(st.integers(0, 5), st.integers(CHUNK_ACTIONS - 2, 2 * CHUNK_ACTIONS + 2)),
    size=st.sampled_from([0, 1, 8, 16, 168, CHUNK_BYTES // 4, CHUNK_BYTES + 8]),
    close=st.booleans(),
    seed=st.integers(0, 9),
)
def test_what_was_done_is_read_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, count: int, size: int, close: bool, seed: int
) -> None:
    path = tmp_path_factory.mktemp("log") / "actions.bin"
    actions = some_actions(min(count, 400_000 // max(1, size)), size, seed)
    header = ActionLogHeader(mode="free", size=size, arrays=[])
    written = write(path, actions, header, close=close)
    log = ActionLog(path)
    assert log.header == header
    assert list(log) == actions
    summary = log.summary()
    assert (summary.mode, summary.actions, summary.size_bytes) == ("free", len(actions), path.stat().st_size)
    assert summary.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert written == (summary if close else None)


def test_the_beginning_says_what_actions_are(tmp_path: Path) -> None:
    wheels = specs.BoundedArray((2,), np.float32, -1, [1, np.inf], name="left, right")
    header = header_of("free", Layout({"grip": specs.Array((), bool), "wheels": wheels}, ACTION_HEADER.size))
    write(tmp_path / "actions.bin", [], header)
    assert ActionLog(tmp_path / "actions.bin").header == header
    name, line = (tmp_path / "actions.bin").read_bytes().splitlines()
    assert name == b"robomaker actions 1"
    assert json.loads(line) == {
        "mode": "free",
        "size": 16,
        "arrays": [
            {"path": ["grip"], "dtype": "bool", "shape": [], "offset": 0},
            {
                "path": ["wheels"], "dtype": "float32", "shape": [2], "offset": 8, "minimum": -1.0,
                "maximum": [1.0, None],
                "description": "left, right",
            },
        ],
    }  # fmt: skip


def test_the_form_is_the_one_that_is_documented(tmp_path: Path) -> None:
    """Read as docs/rerun.md says, by nothing of ours."""
    path, actions = tmp_path / "actions.bin", some_actions(CHUNK_ACTIONS + 3, 5)
    write(path, actions, ActionLogHeader(mode="lockstep", size=5, arrays=[]), close=False)
    rest, read, kinds = path.read_bytes().split(b"\n", 2)[2], [], []
    while rest:
        kind, count, length, first, checksum = struct.unpack("<4sIIQI", rest[:24])
        content, rest = rest[24 : 24 + length], rest[24 + length :]
        assert first == len(read)
        assert zlib.crc32(struct.pack("<IQ", count, first) + content) == checksum
        columns = zstandard.decompress(content) if kind == b"RMAZ" else content
        before = [0] * 5
        for row in range(count):
            before = [byte ^ columns[column * count + row] for column, byte in enumerate(before)]
            read.append(bytes(before))
        kinds.append(kind)
    assert read == actions
    assert kinds == [b"RMAZ", b"RMAP", b"RMAP", b"RMAP"]


KILLED = """
import os, signal, sys
sys.path += os.environ["TESTS"].split(os.pathsep)
from pathlib import Path
from test_action_log import WHEELS, ActionLogWriter, some_actions
writer = ActionLogWriter(Path(sys.argv[1]), WHEELS)
for action in some_actions(int(sys.argv[2]), 16):
    writer.add(action)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_process_that_is_killed_leaves_every_action(tmp_path: Path) -> None:
    environment = {**os.environ, "TESTS": f"{Path(__file__).parent}{os.pathsep}{TESTS}"}
    path, count = tmp_path / "actions.bin", CHUNK_ACTIONS + 7
    ended = subprocess.run([sys.executable, "-c", KILLED, str(path), str(count)], env=environment)
    assert ended.returncode == -9
    assert list(ActionLog(path)) == some_actions(count, 16)


@pytest.mark.parametrize("written", [0, 10, 24, 3000, 10_000])
def test_a_process_that_is_killed_while_it_compresses_loses_one_chunk_at_most(tmp_path: Path, written: int) -> None:
    """Of those that it replaces, some are behind the new chunk, or behind the part of it that was written."""
    actions = some_actions(2 * CHUNK_ACTIONS, 16)
    whole, before = tmp_path / "whole.bin", tmp_path / "before.bin"
    write(whole, actions)
    write(before, actions[:-1], close=False)
    begin = before.read_bytes().index(b"RMAP")
    packed, torn = whole.read_bytes()[begin:], bytearray(before.read_bytes())
    torn[begin : begin + min(written, len(packed))] = packed[:written]
    before.write_bytes(torn)

    read = list(ActionLog(before))

    assert read == actions[: len(read)]
    assert len(read) in (CHUNK_ACTIONS, 2 * CHUNK_ACTIONS - 1, 2 * CHUNK_ACTIONS)


@examples(40)
@given(place=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255), keep=st.floats(0, 1))
def test_of_a_damaged_log_only_what_was_done_is_read(
    tmp_path_factory: pytest.TempPathFactory, place: float, value: int, keep: float
) -> None:
    path = tmp_path_factory.mktemp("log") / "actions.bin"
    actions = some_actions(CHUNK_ACTIONS + 20, 16)
    write(path, actions, close=False)
    begin = path.read_bytes().index(b"\n", len(action_log.MAGIC)) + 1
    data = bytearray(path.read_bytes())
    data[begin + int(place * (len(data) - begin))] = value
    path.write_bytes(data[: begin + int(keep * (len(data) - begin))])
    read = list(ActionLog(path))
    assert read == actions[: len(read)]


@pytest.mark.parametrize(
    "make",
    [
        lambda: zstandard.compress(bytes(2**28)),
        lambda: zstandard.compress(bytes(16))[:-3],
        lambda: b"no frame",
        lambda: b"",
    ],
)
def test_what_is_no_chunk_is_not_unpacked(tmp_path: Path, make: Callable[[], bytes]) -> None:
    """The checksum is right: somebody made it so."""
    path = tmp_path / "actions.bin"
    write(path, some_actions(3, 16))
    with path.open("ab") as file:
        file.write(chunk_of(PACKED, 4, 3, make()))
    assert list(ActionLog(path)) == some_actions(3, 16)


@pytest.mark.parametrize("head", [(b"RMAZ", 2**31, 100, 0), (b"RMAP", 1, 2**32 - 1, 0), (b"RMAP", 0, 16, 0)])
def test_lengths_that_cannot_be_are_not_believed(tmp_path: Path, head: tuple[bytes, int, int, int]) -> None:
    path = tmp_path / "actions.bin"
    write(path, [])
    with path.open("ab") as file:
        file.write(struct.pack("<4sIIQI", *head, zlib.crc32(b"")) + bytes(100))
    assert list(ActionLog(path)) == []


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", ""),
        (b"robomaker digest 1\n", ""),
        (b"robomaker actions 1\n", ": its header: Invalid JSON"),
        (b"robomaker actions 1\n{}\n", ": mode: Field required"),
        (header_line([{"dtype": "float64", "shape": [2], "offset": 0}]), ": arrays.0.path: Field required"),
        (header_line([{"path": [], "dtype": "float64", "shape": "2", "offset": 0}]), ": arrays.0.shape: Input should"),
        (header_line(["float64[2]"]), ": arrays.0: Input should"),
    ],
)
def test_what_is_no_log_is_said(tmp_path: Path, content: bytes, problem: str) -> None:
    """Outputs may come from anybody."""
    (tmp_path / "actions.bin").write_bytes(content)
    with pytest.raises(ActionLogError, match=f"is no log of actions{problem}"):
        ActionLog(tmp_path / "actions.bin")


def test_what_stands_in_its_place_is_not_waited_for(tmp_path: Path) -> None:
    """Applications may write to the folder."""
    path = tmp_path / "actions.bin"
    os.mkfifo(path)
    with pytest.raises(ActionLogError, match=r"cannot be read: .*no regular file"):
        ActionLog(path)
    path.unlink()
    path.symlink_to("/dev/zero")
    with pytest.raises(ActionLogError, match=r"cannot be read: .*symbolic link"):
        ActionLog(path)
    write(path, some_actions(3, 16))
    assert not path.is_symlink()


def test_an_hour_is_small(tmp_path: Path) -> None:
    """20 actions a second, of which one in five is another."""
    rng, path = np.random.default_rng(0), tmp_path / "actions.bin"
    others = [rng.uniform(-1, 1, 2).tobytes() for _ in range(14_400)]
    write(path, [action for action in others for _ in range(5)])
    assert path.stat().st_size < 1.5 * 16 * len(others)


def test_a_log_that_cannot_be_written_fails_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    keeper = ActionRecorder(tmp_path / "gone" / "actions.bin", WHEELS)
    keeper.keep(bytes(16))
    keeper.close()
    assert (keeper.error or "").startswith("FileNotFoundError")
    assert "The robot's actions are not kept, so that the run cannot be repeated: " in capsys.readouterr().err


def test_of_a_log_that_does_not_fit_no_part_is_left(tmp_path: Path) -> None:
    code = """
import resource, sys
sys.path += sys.argv[2:]
from pathlib import Path
from test_action_log import WHEELS, ActionRecorder
import signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
keeper = ActionRecorder(Path(sys.argv[1]), WHEELS)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
for _ in range(100):
    keeper.keep(bytes(16))
keeper.close()
print(keeper.error)
"""
    path = tmp_path / "actions.bin"
    command = [sys.executable, "-c", code, str(path), str(Path(__file__).parent), str(TESTS)]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "File too large" in ended.stdout
    assert not path.exists()
