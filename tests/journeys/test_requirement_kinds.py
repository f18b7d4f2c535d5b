"""A job that is judged by several kinds of requirements, of which it misses one, as a person sees it."""

import json
from pathlib import Path

import pytest
from helpers.cartpole_spec import PACKAGE, poles
from helpers.command_here import Command

pytestmark = pytest.mark.deep

ASKED = """requirements:
            - {kind: speed, name: slow, body: cart, max_mps: 100}
            - {kind: upright, name: stands, body: pole, max_tilt_deg: 0.01}
            - {kind: progress, name: gets-on, body: cart, max_stuck_s: 5}
            - {kind: expression, name: careful, body: cart, formula: "always (abs(x) < 5 -> speed < 100)"}
            - {kind: topic, name: told, topic: /joint_states, min_hz: 1}"""


def test_one_of_several_requirements_is_missed(
    robomaker_at_server: Command, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.syspath_prepend(str(PACKAGE))
    (tmp_path / "spec.yaml").write_text(poles(ASKED))

    ended = robomaker_at_server("run", tmp_path / "spec.yaml")

    assert ended.code == 1, ended.err
    (folder,) = (home / "runs").iterdir()
    assert robomaker_at_server("report", folder, "--junit", tmp_path / "junit.xml").code == 0
    junit, page = (tmp_path / "junit.xml").read_text(), (folder / "report.html").read_text()
    for text in (ended.out, junit, page):
        assert "at most 0.01 deg is allowed" in text
    assert 'failures="1" errors="0"' in junit
    result = next(home.rglob("result.json"))
    found = {item["name"]: item for item in json.loads(result.read_text())["requirements"]}
    assert [name for name, item in found.items() if not item["satisfied"]] == ["stands"], found
    assert all(found[name]["margin"] is not None for name in ("slow", "stands", "gets-on", "careful", "told"))
