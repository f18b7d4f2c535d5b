"""A job that is judged by several kinds of requirements, of which it misses one, as a person sees it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.cartpole_spec import PACKAGE, poles
from helpers.paths import REPOSITORY

pytestmark = pytest.mark.deep

ASKED = """requirements:
            - {kind: speed, name: slow, body: cart, max_mps: 100}
            - {kind: upright, name: stands, body: pole, max_tilt_deg: 0.01}
            - {kind: progress, name: gets-on, body: cart, max_stuck_s: 5}
            - {kind: expression, name: careful, body: cart, formula: "always (abs(x) < 5 -> speed < 100)"}
            - {kind: topic, name: told, topic: /joint_states, min_hz: 1}"""


def test_one_of_several_requirements_is_missed(tmp_path: Path, prefect_server: str) -> None:
    (tmp_path / "spec.yaml").write_text(poles(ASKED))
    environment = {
        **os.environ, "PYTHONPATH": os.pathsep.join(map(str, (PACKAGE, REPOSITORY))),
        "ROBOMAKER_HOME": str(tmp_path / "home"), "PREFECT_API_URL": prefect_server,
    }  # fmt: skip

    def robomaker(*words: object, code: int) -> str:
        command = [sys.executable, "-m", "prefect_robomaker", *map(str, words)]
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert ended.returncode == code, ended.stdout + ended.stderr
        return ended.stdout

    said = robomaker("run", tmp_path / "spec.yaml", code=1)

    (folder,) = (tmp_path / "home" / "runs").iterdir()
    robomaker("report", folder, "--junit", tmp_path / "junit.xml", code=0)
    junit, page = (tmp_path / "junit.xml").read_text(), (folder / "report.html").read_text()
    for text in (said, junit, page):
        assert "at most 0.01 deg is allowed" in text
    assert 'failures="1" errors="0"' in junit
    result = next((tmp_path / "home").rglob("result.json"))
    found = {item["name"]: item for item in json.loads(result.read_text())["requirements"]}
    assert [name for name, item in found.items() if not item["satisfied"]] == ["stands"], found
    assert all(found[name]["margin"] is not None for name in ("slow", "stands", "gets-on", "careful", "told"))
