"""judge: recordings as runs with one job, and the page that shows it."""

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.paths import REPOSITORY
from helpers.recorded_bags import drive, write_bag

PAGE = (REPOSITORY / "docs" / "judging.md").read_text()
GOAL = "{kind: goal, name: there, x: 4, y: 0, within_m: 0.3}"


def shown(name: str) -> str:
    """A file that the page shows."""
    found = re.search(rf"<!-- file: {re.escape(name)} -->\n```yaml\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return found[1]


@pytest.mark.deep
def test_the_page_is_true(
    robomaker_at_server: Callable[..., Any], home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "corridor.yaml").write_text(shown("corridor.yaml"))
    write_bag(tmp_path / "corridor", "sqlite", drive())
    commands = [shlex.split(line)[2:] for line in re.findall(r"^\$ robomaker .*$", PAGE, re.MULTILINE)]
    assert [words[0] for words in commands] == ["judge", "report", "history"]

    judged, _, history = [robomaker_at_server(*words) for words in commands]

    assert judged.code == 0, judged.err + judged.out
    assert "test: request 1 recorded-run" in (tmp_path / "junit.xml").read_text()
    assert "100" in history.out
    [result] = [json.loads(path.read_text()) for path in home.rglob("result.json")]
    assert {each["name"]: each["satisfied"] for each in result["requirements"]} == dict.fromkeys(
        ("end-of-corridor", "polite", "quick"), True
    )
    assert result["extra"]["recording"]["topics"]["/odom"] == 241
    assert result["path"][-1][1] == pytest.approx(4.8, abs=0.05)

    # The robot comes nearer to the wall: the requirements are the same, the bag is another one.
    write_bag(tmp_path / "nearer", "ros1", drive(wall_x=5.0))
    worse = robomaker_at_server("judge", "nearer.bag", "--requirements", "corridor.yaml", "-o", "json")
    assert worse.code == 1, worse.err
    record = json.loads(worse.out)
    assert [(job["verdict"], job["status"]) for job in record["jobs"]] == [("FAIL", "Completed")]
    first, second = sorted((home / "runs").iterdir(), key=lambda path: path.stat().st_mtime)[-2:]
    compared = robomaker_at_server("compare", first.name, second.name, "-o", "json")
    assert compared.code in (1, 6), "the pair is found, as the runs have one name"
    assert json.loads(compared.out)["pairs"] == 1
    [row] = pq.read_table(second / "results.parquet").to_pylist()
    assert (row["verdict"], row["requirement.polite"]) == ("FAIL", False)

    without = [each for each in drive() if each.topic != "/scan"]
    write_bag(tmp_path / "blind", "mcap", without)
    blind = robomaker_at_server("judge", "blind", "--requirements", "corridor.yaml")
    assert blind.code == 3
    assert "no topic /scan" in blind.out + blind.err


@pytest.mark.parametrize(
    ("asked", "words", "says"),
    [
        ("requirements: []", (), "asks for nothing"),
        ("tests: []", (), "tests is not known; requirements and sources would be right"),
        (f"[{GOAL.replace('goal', 'gaol')}]", (), "gaol"),
        (f"requirements: [{GOAL}]\nsources: {{radius: 1}}", (), "sources.radius"),
        (
            f"requirements: [{GOAL}]\nsources: {{pose: /amcl}}",
            (),
            "has no topic /amcl; it has /odom, /scan, /tf_static",
        ),
        ("[{kind: goal, name: there, room: Kitchen}]", (), "--world with the ARN"),
        (f"[{GOAL}]", ("--name", "a b"), "--name is 'a b'"),
    ],
)
def test_what_is_wrong_is_told_in_a_line_before_anything_is_stored(
    robomaker: Callable[..., Any], home: Path, tmp_path: Path, asked: str, words: tuple[str, ...], says: str
) -> None:
    (tmp_path / "asked.yaml").write_text(asked)
    bag = write_bag(tmp_path / "bag", "mcap", drive(seconds=1.0))

    told = robomaker("judge", bag, "--requirements", tmp_path / "asked.yaml", *words)

    assert told.code == 2
    assert says in told.err
    assert len(told.err.strip().splitlines()) == 1, told.err
    assert not home.exists()


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("nothing.mcap", None, "nothing.mcap does not exist; a .mcap, .db3 or .bag"),
        ("empty.mcap", b"", "empty.mcap cannot be read: "),
        ("cut.mcap", b"\x89MCAP0\r\n", "`mcap recover` saves what is there"),
        ("junk.bag", b"#ROSBAG V2.0\nnonsense", "`rosbag reindex` saves what is there"),
        ("junk.db3", b"SQLite format 3\0", "`ros2 bag reindex` saves what is there"),
        ("film.mp4", b"film", "film.mp4 is no recording by its name"),
    ],
)
def test_a_recording_that_cannot_be_read_is_told_in_a_line(
    robomaker: Callable[..., Any], home: Path, tmp_path: Path, name: str, content: bytes | None, says: str
) -> None:
    (tmp_path / "asked.yaml").write_text(f"[{GOAL}]")
    if content is not None:
        (tmp_path / name).write_bytes(content)

    told = robomaker("judge", tmp_path / name, "--requirements", tmp_path / "asked.yaml")

    assert told.code == 2
    assert says in told.err
    assert len(told.err.strip().splitlines()) == 1, told.err
    assert not home.exists()
