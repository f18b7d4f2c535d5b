"""The tutorial about fleets, typed as it stands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.endpoint_process import Serve
from helpers.paths import REPOSITORY

from prefect_robomaker.tasks.service.service import Service

PAGE = (REPOSITORY / "docs" / "fleet" / "fleet-tutorial.md").read_text()
ADDRESS = "http://127.0.0.1:8057"


@pytest.mark.deep
def test_the_tutorial_brings_a_version_to_two_robots_and_takes_a_bad_one_back(
    serve: Serve, service: Service, prefect_server: str, tmp_path: Path
) -> None:
    typed = "\n".join(re.findall(r"^```bash\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
    environ = {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "HOME": str(tmp_path),
        "ROBOMAKER_HOME": str(service.settings.home),
        "PREFECT_API_URL": prefect_server,
    }
    with serve(PREFECT_API_URL=prefect_server, ROBOMAKER_ROBOT_POLL_S="1") as served:
        script = "trap 'kill $(jobs -p); wait' EXIT\n" + typed.replace(ADDRESS, served.url)
        ended = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", script], env=environ, cwd=tmp_path, capture_output=True, text=True
        )

    said = ended.stdout + ended.stderr + "".join(path.read_text() for path in tmp_path.glob("*.log"))
    first, _, second = ended.stdout.partition("It failed, as it should.")
    assert second, said
    assert re.search(r"rover \(wave 1\): InSync(.|\n)*mule \(wave 2\): InSync(.|\n)*Succeeded", first), said
    assert "the robot went back to version 1" in second, said
    assert re.search(r"mule +Registered +courier 1 ", second), said
    assert "courier 1 drives" in (tmp_path / "mule.log").read_text()
    assert "<svg" in (tmp_path / "rollout.html").read_text()
