"""Rights of applications: another user, and the sandbox that works here."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.required_programs import needs

from prefect_robomaker.tasks.fleet.agent.disk import prepare
from prefect_robomaker.tasks.fleet.agent.errors import AgentError
from prefect_robomaker.tasks.fleet.agent.programs.launching import Sandbox, find_sandbox
from prefect_robomaker.tasks.fleet.agent.settings import Connection, Home, Options

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root starts programs as another user")


@pytest.fixture
def home() -> Iterator[Home]:
    """A home that other users may look into, which pytest's own folders keep them from."""
    with tempfile.TemporaryDirectory(prefix="agent-") as folder:
        Path(folder).chmod(0o755)
        made = Home(Path(folder, "home"))
        prepare(made)
        made.save_connection(Connection("http://127.0.0.1", "DEFAULT", "rover", "secret"))
        yield made


def run(sandbox: Sandbox, script: str) -> str:
    data = sandbox.data_folder("courier")
    words = sandbox.wrap(["/bin/sh", "-c", script], data)
    ended = subprocess.run(words, cwd=data, capture_output=True, text=True, **sandbox.rights)
    return ended.stdout.strip()


def test_without_a_sandbox_programs_are_started_as_they_are(home: Home) -> None:
    assert find_sandbox(home, Options(sandbox="none")).wrap(["drive"], home.logs) == ["drive"]


@pytest.mark.skipif(shutil.which("setpriv") is None, reason="needs setpriv, of util-linux")
def test_setpriv_keeps_programs_from_more_rights(home: Home) -> None:
    sandbox = find_sandbox(home, Options(sandbox="setpriv"))

    assert run(sandbox, "grep NoNewPrivs /proc/self/status") == "NoNewPrivs:\t1"


@needs("bubblewrap", shutil.which("bwrap"), "bwrap is not installed")
def test_bwrap_leaves_only_the_data_to_write_and_hides_the_token(home: Home) -> None:
    try:
        sandbox = find_sandbox(home, Options(sandbox="bwrap"))
    except AgentError:
        pytest.skip("bwrap does not work here")
    outside = home.folder / "versions" / "evil"

    assert run(sandbox, f"cat {home.connection_file}; touch {outside}; touch mine && echo wrote") == "wrote"
    assert not outside.exists()
    assert (home.folder / "data/courier/mine").exists()


@needs_root
def test_programs_have_a_user_of_their_own(home: Home) -> None:
    sandbox = find_sandbox(home, Options(user="nobody", sandbox="none"))

    assert run(sandbox, "id -un; touch mine && echo wrote").split() == ["nobody", "wrote"]
    assert run(sandbox, f"cat {home.connection_file}") == "", "the token is the agent's"


def test_users_and_sandboxes_that_are_not_there_are_told(home: Home) -> None:
    with pytest.raises(AgentError, match="--user: there is no user 'courier-7'"):
        find_sandbox(home, Options(user="courier-7"))
    with pytest.raises(AgentError, match="--sandbox: 'jail' is not right"):
        find_sandbox(home, Options(sandbox="jail"))
