"""Login secret of the home's Prefect server, login links, and the server's settings."""

import base64
import json
import os
import secrets
import stat
import urllib.error
import urllib.request
from pathlib import Path

from ...schemas.settings import Settings
from ...schemas.wire.errors import ConfigurationError
from ...tasks.service.data_home import prepare_home

FILE = "auth"
_USER = "robomaker"
_SECRET_BYTES = 32


def server_folder(settings: Settings) -> Path:
    """Returns the folder of the data home's Prefect server, private to its owner.

    Raises:
        ConfigurationError: The data home cannot be used.
    """
    prepare_home(settings)
    folder = settings.home / "prefect"
    folder.mkdir(mode=0o700, exist_ok=True)
    if stat.S_IMODE(folder.stat().st_mode) & 0o077:
        folder.chmod(0o700)  # of a home that was copied
    return folder


def auth_string(settings: Settings) -> str:
    """Returns the login secret (`user:secret`) of the home's Prefect server, created on first use.

    Raises:
        ConfigurationError: The file cannot be read, or others could read it.
    """
    path = server_folder(settings) / FILE
    if not path.exists():
        _make(path)
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        text = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"the secret of the Prefect server in {path} cannot be read: {error}") from error
    if mode & 0o077:
        raise ConfigurationError(
            f"the secret of the Prefect server in {path} has mode {mode:04o}, so others may have read it; "
            "remove the file and restart the server (robomaker server stop), which makes a new one"
        )
    user, _, secret = text.partition(":")
    if not (user and secret):
        raise ConfigurationError(f"{path} holds no secret; remove it and restart the server (robomaker server stop)")
    return text


def _make(path: Path) -> None:
    """Writes a new secret file that only this user may read, unless another process has written one first.

    The file never exists without its content.
    """
    temporary = path.with_name(f"{FILE}.{os.getpid()}.{secrets.token_hex(4)}")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(f"{_USER}:{secrets.token_urlsafe(_SECRET_BYTES)}\n")
    try:
        os.link(temporary, path)
    except FileExistsError:
        pass
    finally:
        temporary.unlink()


# Slots held by a process that was killed come back also when the server was killed with it.
_LEASE_STORAGE = "prefect.server.concurrency.lease_storage.filesystem"


def server_variables(folder: Path, port: int, auth_string: str) -> dict[str, str]:
    """Returns the environment variables for the Prefect server's process.

    Args:
        folder: Folder of the server's database.
        port: Port of 127.0.0.1 that it listens at.
        auth_string: Credentials that every request needs, `user:secret`.
    """
    return {
        "PREFECT_HOME": str(folder),
        # The port alone does not reach the pages, which would look for their API at port 4200.
        "PREFECT_SERVER_API_HOST": "127.0.0.1",
        "PREFECT_SERVER_API_PORT": str(port),
        "PREFECT_SERVER_UI_API_URL": f"http://127.0.0.1:{port}/api",
        "PREFECT_SERVER_API_AUTH_STRING": auth_string,
        "PREFECT_SERVER_CSRF_PROTECTION_ENABLED": "true",
        "PREFECT_SERVER_CORS_ALLOWED_ORIGINS": f"http://127.0.0.1:{port}",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "PREFECT_SERVER_UI_SHOW_PROMOTIONAL_CONTENT": "false",
        "PREFECT_SERVER_CONCURRENCY_LEASE_STORAGE": _LEASE_STORAGE,
        # Without both `prefect deployment run --watch` shows no log, and so not why a run failed.
        "PREFECT_SERVER_LOGS_STREAM_OUT_ENABLED": "true",
        "PREFECT_SERVER_LOGS_STREAM_PUBLISHING_ENABLED": "true",
        # Each look costs an idle server as much as two requests. Prefect looks every 5 to 20 s; nothing of ours waits
        # for these: `dead_run_sweeper` closes what is open in cancelled runs.
        "PREFECT_SERVER_SERVICES_LATE_RUNS_LOOP_SECONDS": "15",  # runs are called late once they are 15 s late
        "PREFECT_SERVER_SERVICES_SCHEDULER_RECENT_DEPLOYMENTS_LOOP_SECONDS": "10",
        "PREFECT_SERVER_SERVICES_FOREMAN_LOOP_SECONDS": "30",
        "PREFECT_SERVER_SERVICES_PAUSE_EXPIRATIONS_LOOP_SECONDS": "30",
        "PREFECT_SERVER_SERVICES_CLEANUP_RECONCILER_LOOP_SECONDS": "30",
        "PREFECT_SERVER_SERVICES_CANCELLATION_CLEANUP_LOOP_SECONDS": "60",
    }


_TIMEOUT_S = 10.0

# The server is on this machine: no proxy has to see the secret.
_OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))


def login_link(api_url: str, auth_string: str) -> str | None:
    """Returns a link that logs one browser in to the Prefect server, within ten minutes.

    Args:
        api_url: API of the server.
        auth_string: The server's, `user:secret`.
    """
    basic = base64.b64encode(auth_string.encode()).decode()
    request = urllib.request.Request(  # noqa: S310 - an http URL of ours
        f"{api_url.removesuffix('/api')}/robomaker/login-links",
        data=b"",
        method="POST",
        headers={"Authorization": f"Basic {basic}"},
    )
    try:
        with _OPENER.open(request, timeout=_TIMEOUT_S) as answer:
            return str(json.load(answer)["link"])
    except (urllib.error.URLError, OSError, ValueError, KeyError):
        return None
