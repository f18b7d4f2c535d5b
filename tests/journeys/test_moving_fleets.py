"""The page about moving fleets, typed as it stands."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.deployments.cli.grammar import build_parser
from prefect_robomaker.tasks.service.service import Service

PAGE = (REPOSITORY / "docs" / "fleet" / "moving-fleets.md").read_text()


def test_each_command_is_understood() -> None:
    """The command line's own grammar takes them as they stand, before the shell puts values in."""
    lines = "".join(re.findall(r"^```bash\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)).splitlines()
    typed = [shlex.split(line.partition("robomaker ")[2].removesuffix(" | arn)")) for line in lines]
    commands = [words[: words.index(">")] if ">" in words else words for words in typed if words]

    assert len(commands) >= 5
    for words in commands:
        build_parser().parse_args(words)


@pytest.mark.endurance  # test_fleet_tutorial.py types the same commands, and robots enrol by the tokens
def test_a_list_of_robots_becomes_a_fleet_whose_robots_can_enrol(service: Service, tmp_path: Path) -> None:
    typed = "\n".join(re.findall(r"^```bash\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
    environ = {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "HOME": str(tmp_path),
        "ROBOMAKER_HOME": str(service.settings.home),
    }
    ended = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", typed], env=environ, cwd=tmp_path, capture_output=True, text=True
    )

    assert ended.returncode == 0, ended.stderr
    assert "yard: 2 robots" in ended.stdout
    for name in ("rover", "mule"):
        assert re.search(rf"^{name} +Registered", ended.stdout, re.MULTILINE)
        assert f"--name {name}\n" in (tmp_path / f"{name}.token.txt").read_text()
