"""A job that is judged by several kinds of requirements, of which it misses one, as a person sees it."""

import json
from pathlib import Path

import pytest
from helpers.cartpole_spec import PACKAGE, poles
from helpers.command_here import Command

pytestmark = pytest.mark.deep

ASKED = """requirements: [
          {kind: speed, name: slow, body: cart, max_mps: 100},
          {kind: upright, name: stands, body: pole_1, max_tilt_deg: 1},
          {kind: progress, name: gets-on, body: cart, max_stuck_s: 5},
          {kind: expression, name: careful, body: cart, formula: "always (abs(x) < 5 -> speed < 100)"},
          {kind: topic, name: told, topic: /joint_states, min_hz: 1}]"""


def test_one_of_several_requirements_is_missed(
    robomaker: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, prefect_server: str
) -> None:
    monkeypatch.syspath_prepend(str(PACKAGE))
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.setenv("PREFECT_API_URL", prefect_server)
    (tmp_path / "spec.yaml").write_text(poles(ASKED))

    ended = robomaker("run", tmp_path / "spec.yaml")

    said = ended.out + ended.err
    assert ended.code == 1, said
    (folder,) = (tmp_path / "home" / "runs").iterdir()
    table = robomaker("report", folder, "-o", "json", "--junit", tmp_path / "junit.xml").out
    junit, page = (tmp_path / "junit.xml").read_text(), (folder / "report.html").read_text()
    for text in (said, junit, page):
        assert "1 deg allowed" in text
    assert 'failures="1" errors="0"' in junit
    (job,) = [job for step in json.loads(table)["steps"] for job in step.get("jobs", [])]
    found = {item["name"]: item for item in job["requirements"]}
    assert [name for name, item in found.items() if not item["satisfied"]] == ["stands"]
    assert all(item.get("margin") is not None for item in found.values())
