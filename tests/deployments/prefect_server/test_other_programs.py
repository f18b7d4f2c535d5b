"""Prefect's own command and workers use the local server, as documented; without its secret nothing does."""

import io
import os
import shlex
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

import pytest
from helpers.paths import REPOSITORY
from helpers.prefect_server import server_settings
from helpers.processes import alive, process_worker

from prefect_robomaker.deployments.cli.main import main
from prefect_robomaker.deployments.prefect_server.local_server import server_status
from prefect_robomaker.deployments.prefect_server.secret import auth_string


def run(environ: dict[str, str], *command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, env=environ, cwd=REPOSITORY, capture_output=True, text=True, check=False, timeout=290
    )


def robomaker(environ: dict[str, str], *words: str) -> tuple[int, str, str]:
    """Exit code, output and errors of a command, run in this process as if it had that environment."""
    out, err = io.StringIO(), io.StringIO()
    with mock.patch.dict(os.environ, environ, clear=True), redirect_stdout(out), redirect_stderr(err):
        code = main(words)
    return code, out.getvalue(), err.getvalue()


@pytest.fixture
def environ(prefect_server: str, tmp_path: Path) -> dict[str, str]:
    """A user's environment that knows the data home, and nothing of Prefect."""
    del prefect_server
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    own = {"ROBOMAKER_HOME": str(server_settings().home), "PREFECT_HOME": str(tmp_path / "prefect")}
    return {**kept, **own, "HOME": str(tmp_path), "PREFECT_WORKER_QUERY_SECONDS": "1", "COLUMNS": "200"}


def exported(environ: dict[str, str]) -> dict[str, str]:
    """What `robomaker server env` exports."""
    code, printed, said = robomaker(environ, "server", "env")
    assert code == 0, said
    words = (shlex.split(line) for line in printed.splitlines())
    return dict(word.split("=", 1) for export, word in words if export == "export")


def test_env_prints_what_other_programs_need(environ: dict[str, str], prefect_server: str) -> None:
    variables = exported(environ)

    assert variables == {"PREFECT_API_URL": prefect_server, "PREFECT_API_AUTH_STRING": auth_string(server_settings())}
    # Also to somebody who has exported the address alone, or an old secret.
    assert exported({**environ, "PREFECT_API_URL": prefect_server}) == variables
    assert exported({**environ, **variables, "PREFECT_API_AUTH_STRING": "robomaker:old"}) == variables
    elsewhere = {"PREFECT_API_URL": "http://127.0.0.1:1/api"}
    assert robomaker({**environ, **elsewhere}, "server", "env")[0] == 2


@pytest.mark.deep
def test_a_deployment_is_made_and_run_by_prefects_command(environ: dict[str, str], tmp_path: Path) -> None:
    known = {**environ, **exported(environ)}
    prefect = [sys.executable, "-m", "prefect"]
    stranger = {**environ, "PREFECT_API_URL": known["PREFECT_API_URL"]}
    refused = run(stranger, *prefect, "work-pool", "create", "of-a-stranger", "--type", "process")
    assert refused.returncode != 0
    assert "401" in refused.stdout + refused.stderr

    for words in (
        ["work-pool", "create", "robomaker-env", "--type", "process"],
        ["--no-prompt", "deploy", "--name", "create-world-template", "--prefect-file",
         "deployments/prefect.yaml", "--pool", "robomaker-env"],
    ):  # fmt: skip
        made = run(known, *prefect, *words)
        assert made.returncode == 0, made.stdout + made.stderr
    with process_worker("robomaker-env", known, tmp_path / "worker.log"):
        parameters = '{"name": "by the command", "templateBody": "{}"}'
        ordered = run(
            known,
            *prefect,
            "deployment",
            "run",
            "CreateWorldTemplate/create-world-template",
            "--params",
            parameters,
            "--watch",
        )

    assert ordered.returncode == 0, ordered.stdout + ordered.stderr + (tmp_path / "worker.log").read_text()
    assert "Completed" in ordered.stdout
    pools = run(known, *prefect, "work-pool", "ls").stdout
    assert "robomaker-env" in pools
    assert "of-a-stranger" not in pools


def test_the_secret_is_in_no_command_line_and_in_no_log(environ: dict[str, str]) -> None:
    secret = auth_string(server_settings()).partition(":")[2]
    status = server_status(server_settings(), {})
    assert status.pid is not None
    assert alive({status.pid})

    for process in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            assert secret.encode() not in process.read_bytes()
        except OSError:
            continue  # it has ended
    assert secret not in Path(f"/proc/{status.pid}/environ").read_text()
    assert secret not in Path(str(status.log)).read_text()
    for words in (["server", "status"], ["server", "start"], ["doctor"]):
        _, told, complained = robomaker(environ, *words)
        assert told
        assert secret not in told + complained
