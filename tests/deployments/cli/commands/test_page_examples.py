"""Specifications that pages of the documentation show, run as readers would."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.paths import REPOSITORY

pytestmark = pytest.mark.deep
DOCS = REPOSITORY / "docs"
RunExample = Callable[..., tuple[dict[str, Any], list[dict[str, Any]]]]


@pytest.fixture
def run_example(
    robomaker_at_server: Callable[..., Any], home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> RunExample:
    """Runs a page's specification; returns the run's record and the jobs' results."""

    def run(page: str, having: str = "\nsteps:") -> tuple[dict[str, Any], list[dict[str, Any]]]:
        text = (DOCS / f"{page}.md").read_text()
        blocks = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
        spec = next(block for block in blocks if "\nsteps:" in block and having in block)
        monkeypatch.chdir(tmp_path)
        (tmp_path / "spec.yaml").write_text(spec)
        ended = robomaker_at_server("run", "spec.yaml", "-o", "json")
        assert ended.code == 0, ended.err
        return json.loads(ended.out), [json.loads(each.read_text()) for each in sorted(home.rglob("result.json"))]

    return run


def test_the_example_of_requirements_meets_all_of_them(run_example: RunExample) -> None:
    record, results = run_example("verdicts", "name: at-home")
    assert [job["verdict"] for job in record["jobs"]] == ["PASS"] * 4
    for result in results:
        judged = {each["name"]: each["satisfied"] for each in result["requirements"] if each["counts"]}
        assert judged == dict.fromkeys(
            ("at-home", "to-bed", "gentle", "polite", "quick", "calm", "direct", "careful"), True
        )
        assert result["ended_by"] == "requirements"
        assert result["sim_time_s"] > 2, "the bedroom is a way off"


def test_the_example_of_trials_has_a_row_for_each(
    run_example: RunExample, robomaker_at_server: Callable[..., Any], home: Path
) -> None:
    record, results = run_example("trials")
    assert [job["verdict"] for job in record["jobs"]] == ["PASS"]
    [table] = home.rglob("trials.parquet")
    rows = pq.read_table(table).to_pylist()
    assert [row["verdict"] for row in rows] == ["PASS"] * 20
    assert [row["seed"] for row in rows] == 4 * list(range(5))
    assert [row["axis.ROBOMAKER_SIM_TIME_LIMIT_S"] for row in rows] == ["120"] * 10 + ["240"] * 10
    assert [row["axis.mass"] for row in rows] == 2 * ([1.0] * 5 + [1.1] * 5)
    assert [row["trial"] for row in rows if row["recorded"]] == [0]
    # A longer limit changes nothing for those that are faster.
    digests = [row["state_digest"] for row in rows]
    assert digests[:10] == digests[10:]
    assert len(set(digests)) == 10  # other seeds and other masses
    verified = robomaker_at_server("verify", record["jobs"][0]["arn"], "--trial", "6")
    assert verified.out.startswith("bit-identical: "), verified
    assert len(results) == 2, "the job's, and that of the trial that was recorded"


def test_the_example_of_videos_is_filmed(run_example: RunExample, home: Path) -> None:
    record, _ = run_example("videos")
    assert record["jobs"][0]["remarks"] == []
    [film] = home.rglob("video.mp4")
    assert film.stat().st_size > 10_000
