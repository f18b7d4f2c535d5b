"""Prefect's own command and workers use the local server, as documented; without its secret nothing does."""

import io
import os
import shlex
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

import pytest
from helpers.prefect_server import server_settings
from helpers.processes import alive

from prefect_robomaker.deployments.cli.main import main
from prefect_robomaker.deployments.prefect_server.local_server import server_status
from prefect_robomaker.deployments.prefect_server.secret import auth_string


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


def test_nothing_is_made_without_the_secret(environ: dict[str, str]) -> None:
    """Prefect's command with what `env` prints makes a pool in tests/deployments/test_scheduled_runs.py."""
    from prefect.client.orchestration import SyncPrefectClient, get_client
    from prefect.client.schemas.actions import WorkPoolCreate
    from prefect.exceptions import PrefectHTTPStatusError

    pool = WorkPoolCreate(name="of-a-stranger", type="process")
    url = exported(environ)["PREFECT_API_URL"]
    with SyncPrefectClient(url) as stranger, pytest.raises(PrefectHTTPStatusError, match="401"):
        stranger.create_work_pool(pool)

    with get_client(sync_client=True) as client:
        assert pool.name not in {pool.name for pool in client.read_work_pools()}


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
