"""The page about a fault: its commands, typed one after the other, say what it says."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

PAGE = REPOSITORY / "docs" / "a-fault-found.md"
EXAMPLE = REPOSITORY / "deployments" / "specs" / "examples" / "fault_found"
DOOR_X_M, LEAF_LEFT_Y_M = 2.5, 0.25
"""Place of the door, and the edge of its left leaf when it is half shut."""
END = "=== end of command, exit code "


def shown(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)


def typed() -> list[tuple[str, list[str]]]:
    """The page's commands, each with the lines that it shows of their output."""
    found: list[tuple[str, list[str]]] = []
    for line in "".join(shown("console")).splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return found


def stable(line: str) -> str:
    """A line without what differs from run to run: ids, times, folders, and spaces at its beginning.

    How many jobs have still ended, after those that decided, depends on the machine.
    """
    line = re.sub(r"\d+ of \d+ jobs passed \(.*?\), \d+ canceled|\d+ trials saved", "…", line)
    return re.sub(r"(sim|courier)-[0-9a-zT]{12,}|after .*? s$|/\S+/(?=fault_found)", "…", line).strip()


def test_the_page_shows_the_files_of_the_example() -> None:
    assert shown("yaml") == [(EXAMPLE / "courier.yaml").read_text()]
    assert shown("diff") == [(EXAMPLE / "fix.patch").read_text()]


def last_place(recording: Path) -> tuple[float, float]:
    """x and y in metres at which the robot of a recording ends."""
    with recording.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        *_, last = reader.iter_decoded_messages(topics=["/joint_states"])
    joints = dict(zip(last.decoded_message.name, last.decoded_message.position, strict=True))
    return joints["x"], joints["y"]


@pytest.mark.deep
def test_the_fault_is_found_explained_mended_and_shown_to_be_better(prefect_server: str, tmp_path: Path) -> None:
    commands = typed()
    script = "\n".join(f"{command}\ncode=$?; echo; echo {shlex.quote(END)}$code" for command, _ in commands)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    own = {"PATH": path, "HOME": str(tmp_path), "ROBOMAKER_HOME": str(tmp_path / "home")}
    environ = {**os.environ, **own, "PREFECT_API_URL": prefect_server}
    ended = subprocess.run(["bash", "-c", script], env=environ, cwd=REPOSITORY, capture_output=True, text=True)

    print(ended.stdout, ended.stderr)  # pytest shows it where the test fails
    parts = re.split(rf"^{END}(\d+)\n", ended.stdout, flags=re.MULTILINE)
    codes = {command.split(" --to")[0]: int(code) for (command, _), code in zip(commands, parts[1::2], strict=True)}
    failing = {command for command, code in codes.items() if code}
    assert failing == {"robomaker run courier.yaml"}, (codes, ended.stderr)
    assert codes["robomaker run courier.yaml"] == 1
    for (command, lines), output in zip(commands, parts[::2], strict=False):
        told = {stable(line) for line in output.splitlines()}
        assert {stable(line) for line in lines} - {"…"} <= told, (command, output)
    x, y = last_place(tmp_path / "fault_found" / "seen" / "rerun" / "output" / "recording.mcap")
    assert x < DOOR_X_M, "before the door"
    assert y > LEAF_LEFT_Y_M, "before its left leaf, not in the opening"
    decided = re.search(r"decided after (\d+) of 256 pairs; .*; (\d+) trials saved", ended.stdout)
    planned = re.search(r"with a chance of 80%: (\d+) trials in each", ended.stdout)
    assert decided is not None
    assert planned is not None
    assert int(decided[1]) < int(planned[1]), "fewer trials than were planned"
    assert int(decided[2]) > 0
    assert int(decided[1]) + int(decided[2]) <= 256, "jobs that ran meanwhile are not saved"
