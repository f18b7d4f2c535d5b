"""The agent in a container, whose image is built as its Containerfile says."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.agent_robot import rover
from helpers.container_images import PROGRAMS, write_root
from helpers.paths import REPOSITORY
from helpers.real_engine import RealEngine

from .conftest import deploy

AGENT = REPOSITORY / "tasks" / "fleet" / "agent"
USER_ID = 10001
"""Of the user `robot`, whom the Containerfile makes."""

BASE = """\
FROM {root}
COPY pip /usr/lib/{python}/site-packages/pip
COPY wheels /wheels
ENV PIP_NO_INDEX=1 PIP_FIND_LINKS=/wheels
RUN printf '#!/bin/sh\\nexec python3 -m pip "$@"\\n' > /bin/pip && chmod 755 /bin/pip && touch /etc/group /etc/shadow
"""

pytestmark = [pytest.mark.deep, pytest.mark.timeout(1200)]


@pytest.fixture(scope="module")
def image(real_engine: RealEngine, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The Containerfile's image, on a base of this machine's programs: neither registry nor index is needed for it."""
    folder = tmp_path_factory.mktemp("base")
    write_root(folder / "root.tar", python=True, programs=(*PROGRAMS, "useradd"))
    root, base, name = (
        real_engine.note_image(f"{real_engine.prefix}/agent-{each}:1") for each in ("root", "base", "own")
    )
    real_engine.call("import", str(folder / "root.tar"), root)
    (folder / "root.tar").unlink()
    _add_pip(folder)
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    _build(real_engine, base, BASE.format(root=root, python=python), folder)
    lines = (AGENT / "Containerfile").read_text()
    _build(real_engine, name, re.sub("^FROM .*$", f"FROM {base}", lines, flags=re.MULTILINE), AGENT.parents[1])
    return name


def _add_pip(folder: Path) -> None:
    """Puts pip, and the wheels that the agent needs, into a folder."""
    found = importlib.util.find_spec("pip")
    if found is None or found.origin is None:
        pytest.skip("pip is not installed here")
    shutil.copytree(Path(found.origin).parent, folder / "pip", ignore=shutil.ignore_patterns("__pycache__"))
    command = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--only-binary",
        ":all:",
        "--dest",
        folder / "wheels",
    ]
    done = subprocess.run([*command, "tuf>=6,<8", "setuptools>=77"], capture_output=True, text=True, timeout=600)
    if done.returncode != 0:
        pytest.skip(f"what the agent needs cannot be had here: {done.stderr[-300:]}")


def _build(engine: RealEngine, name: str, lines: str, context: Path) -> None:
    command = [engine.program, "build", "--network", "host", "--tag", name, "--file", "-", str(context)]
    done = subprocess.run(
        command, env={**os.environ, **engine.environ}, input=lines, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def test_the_image_has_the_agent_and_a_user_and_no_source(real_engine: RealEngine, image: str) -> None:
    run = ("run", "--rm", "--network", "host")
    asked = "id -u robot; robomaker-agent run --help; echo /*"
    said = real_engine.call(*run, "--entrypoint", "sh", image, "-c", asked)
    assert said.splitlines()[0] == str(USER_ID)
    assert "--health-command" in said
    assert "source" not in said.splitlines()[-1].split("/")
    started = subprocess.run(
        [real_engine.program, *run, image],
        env={**os.environ, **real_engine.environ},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert "enroll this robot first" in started.stderr, started


def test_an_agent_in_a_container_installs_and_its_application_is_not_root(
    real_engine: RealEngine, image: str, tmp_path: Path
) -> None:
    command = (
        *(real_engine.program, "run", "--rm", "--init", "--network", "host", "-v", f"{tmp_path}:{tmp_path}"),
        *("--entrypoint", "python3", image),
    )
    tmp_path.chmod(0o777)
    options = ("--user", "robot", "--health-s", "0.5")
    who = f"#!/bin/sh\nid -u > {tmp_path}/who\nexec sleep 1000\n"
    with rover(
        tmp_path, module="robomaker_agent", command=command, environ=real_engine.environ, options=options
    ) as robot:
        deploy(robot, 1, who)
        robot.agent.start()
        first = robot.server.wait_for_end(1)
        assert first.feedback.finished == "success", (first, robot.agent.log)
        assert int((tmp_path / "who").read_text()) == USER_ID

        assert robot.agent.stop() == 0, "docker stops it as systemd does"
        robot.agent.start()
        deploy(robot, 2)
        assert robot.server.wait_for_end(2).feedback.finished == "success", robot.agent.log
        assert robot.agent.journal["good"]["version"] == "2", "the volume has what it had installed"
