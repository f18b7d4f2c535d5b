"""Finds, starts and stops the local Prefect server, which runs in the background and is reused.

An ephemeral server costs 12-20 CPU-seconds in every run; this one costs them once. It listens on
127.0.0.1 only, keeps its database under the data home, and is found again through a state file
there. Where `PREFECT_API_URL` is set, or a Prefect profile that has it is active, that server is
used and none is started.
"""

import dataclasses
import fcntl
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from urllib.parse import urlsplit

from ...schemas.settings import Settings
from ...schemas.wire.errors import ConfigurationError, RobomakerError
from ...tasks.files.whole_files import write_whole
from .outage import BUSY_PATIENCE_S, Health, health_of, wait_while_busy
from .secret import auth_string, server_folder

START_TIMEOUT_S = 180.0
_PROGRAM = "prefect_robomaker.deployments.prefect_server"
_CLIENT_VARIABLES = ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING", "PREFECT_API_KEY", "PREFECT_PROFILE")
_PORTS = range(20_000, 32_768)
"""Ports of the local server.

They are below those that Linux gives to clients: while the server is away, one of these could be given its port.
"""


class LocalServerError(RobomakerError):
    """Raised when the local Prefect server did not start; contains its last log lines."""


@dataclass(frozen=True)
class ServerStatus:
    """Status of the Prefect server of a data home."""

    running: bool
    """Whether the Prefect server answers."""

    api_url: str | None = None
    pid: int | None = None
    log: str | None = None
    configured_elsewhere: bool = False
    """Whether `PREFECT_API_URL` or a Prefect profile names the server, so that none is started here."""

    busy: bool = False
    """Whether the Prefect server exists but has not answered in time."""


def ensure_server(
    settings: Settings, environ: Mapping[str, str] | None = None, meanwhile: Callable[[str], None] = lambda _: None
) -> str:
    """Returns the API URL of the Prefect server, starting a local one if none is configured.

    One that is busy is waited for, and a local one that stays so is started again.

    Args:
        settings: The data home's.
        environ: Variables that may name a server, usually `os.environ`.
        meanwhile: Called with the URL of a server that has just been started, and does not answer yet.

    Raises:
        LocalServerError: The server did not answer in time.
        ConfigurationError: A configured server does not answer.
    """
    status = _status_once_idle(settings, environ)
    if status.configured_elsewhere:
        if not status.running:
            silent = (
                f"it has not answered for {BUSY_PATIENCE_S:g} s" if status.busy else "nothing healthy answers there"
            )
            raise ConfigurationError(
                f"PREFECT_API_URL is {status.api_url!r}, and {silent}; "
                "start that server, or unset the variable to use a local one"
            )
        return str(status.api_url)
    if status.running:
        return str(status.api_url)
    with _locked(settings):
        status = server_status(settings, environ)
        return str(status.api_url) if status.running else _start(settings, meanwhile)


def client_variables(api_url: str, settings: Settings, environ: Mapping[str, str] | None = None) -> dict[str, str]:
    """Returns the environment variables with which Prefect's client uses a server.

    Args:
        api_url: API URL of the Prefect server, from `ensure_server`.
        settings: The data home's.
        environ: Variables that are there already, usually `os.environ`.

    Raises:
        ConfigurationError: The secret of the local server cannot be used.
    """
    given = os.environ if environ is None else environ
    variables = {"PREFECT_API_URL": api_url}
    # One's own server may also be named by PREFECT_API_URL; what logs in elsewhere is for its user to say.
    known = _known_server(settings)
    if configured_api_url(given) is None or (api_url == known.api_url and _is_alive(known)):
        variables["PREFECT_API_AUTH_STRING"] = auth_string(settings)
    return variables


def is_own_server(api_url: str, settings: Settings) -> bool:
    """Whether a URL is that of the data home's own Prefect server."""
    return _known_server(settings).api_url == api_url


def is_at_own_port(api_url: str, settings: Settings) -> bool:
    """Whether a URL is where the data home's own Prefect server answers, or would answer if it were started."""
    parts = urlsplit(api_url)
    try:
        own = int((server_folder(settings) / "port").read_text())
        return parts.hostname in ("127.0.0.1", "localhost") and parts.port == own
    except (OSError, ValueError):
        return False


def server_status(settings: Settings, environ: Mapping[str, str] | None = None) -> ServerStatus:
    """Returns which Prefect server would be used, and whether it answers, answers not in time (busy), or does not run.

    The server that variables or Prefect's profile name comes before the local one of the data home.
    """
    if url := configured_api_url(os.environ if environ is None else environ):
        status = ServerStatus(running=False, api_url=url, configured_elsewhere=True)
    else:
        status = _known_server(settings)
        if not _is_alive(status):
            return dataclasses.replace(status, running=False)
    health = health_of(str(status.api_url))
    return dataclasses.replace(status, running=health is Health.HEALTHY, busy=health is Health.BUSY)


def stop_server(settings: Settings) -> bool:
    """Stops the local Prefect server; returns whether one was running."""
    with _locked(settings):
        return _stop(settings)


def configured_api_url(environ: Mapping[str, str]) -> str | None:
    """Returns the Prefect API URL that the variables or the active Prefect profile configure.

    Returns None if neither names one, or the profiles cannot be read.
    """
    if url := environ.get("PREFECT_API_URL"):
        return url
    home = Path(environ.get("PREFECT_HOME") or Path.home() / ".prefect")
    path = Path(environ.get("PREFECT_PROFILES_PATH") or home / "profiles.toml")
    try:
        profiles = tomllib.loads(path.read_text())
    except (OSError, tomllib.TOMLDecodeError):
        return None
    active = environ.get("PREFECT_PROFILE") or profiles.get("active")
    url = profiles.get("profiles", {}).get(active, {}).get("PREFECT_API_URL")
    return str(url) if url else None


def _status_once_idle(settings: Settings, environ: Mapping[str, str] | None) -> ServerStatus:
    """Returns the Prefect server's status, after waiting for a busy server for some time; it may still be busy then."""
    status = server_status(settings, environ)
    if status.busy:
        api_url = str(status.api_url)
        health = wait_while_busy(lambda: health_of(api_url), f"the Prefect server at {api_url}")
        status = dataclasses.replace(status, running=health is Health.HEALTHY, busy=health is Health.BUSY)
    return status


def _start(settings: Settings, meanwhile: Callable[[str], None]) -> str:
    _stop(settings)  # one that does not answer
    auth_string(settings)  # a secret that cannot be used is told here, not in the server's log
    folder = server_folder(settings)
    log = folder / "server.log"
    # The server inherits the socket: until it answers, no other program can take the port and get our secret.
    with _listener(folder / "port") as listener, log.open("wb") as output:
        port = str(listener.getsockname()[1])
        api_url = f"http://127.0.0.1:{port}/api"
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", _PROGRAM, "--port", port, "--socket", str(listener.fileno())],
            pass_fds=[listener.fileno()],
            env={**_without_client_variables(os.environ), "ROBOMAKER_HOME": str(settings.home)},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            cwd=folder,
        )
    try:
        meanwhile(api_url)
        _wait_until_healthy(process, api_url, log)
        status = ServerStatus(running=True, api_url=api_url, pid=process.pid, log=str(log))
        known = {name: value for name, value in asdict(status).items() if value}
        write_whole(_state_file(settings), json.dumps(known))
    except BaseException:  # also Ctrl-C: without its state file the server would not be found again
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        raise
    # The server outlives this process on purpose, so it is not waited for.
    process.returncode = 0
    return api_url


def _without_client_variables(environ: Mapping[str, str]) -> dict[str, str]:
    """Removes variables of Prefect's clients from a server's environment; it reads its secret from the file."""
    return {name: value for name, value in environ.items() if name not in _CLIENT_VARIABLES}


def _stop(settings: Settings) -> bool:
    """Ends the Prefect server that the state file names, by force if it does not end within 15 s; deletes that file.

    Returns False if no such server was running.
    """
    status = _known_server(settings)
    _state_file(settings).unlink(missing_ok=True)
    if status.pid is None or not _is_alive(status):
        return False
    for number, patience_s in ((signal.SIGTERM, 15.0), (signal.SIGKILL, 5.0)):
        with suppress(ProcessLookupError):  # it may end by itself at any moment
            os.killpg(status.pid, number)
        deadline = time.monotonic() + patience_s
        while not (has_ended := _has_ended(status.pid)) and time.monotonic() < deadline:
            time.sleep(0.1)
        if has_ended:
            break
    return True


def _wait_until_healthy(process: subprocess.Popen[bytes], api_url: str, log: Path) -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline:
        if health_of(api_url) is Health.HEALTHY:
            return
        if process.poll() is not None:
            break
        time.sleep(0.1)
    lines = log.read_text(errors="replace").strip().splitlines()[-8:]
    raise LocalServerError("the local Prefect server did not start:\n  " + "\n  ".join(lines))


def _is_alive(status: ServerStatus) -> bool:
    """Whether the process of a recorded server is that server of Prefect: process ids are reused after a reboot."""
    try:
        arguments = set(Path(f"/proc/{status.pid}/cmdline").read_bytes().decode(errors="replace").split("\0"))
    except OSError:
        return False
    return {_PROGRAM, "--port", str(urlsplit(status.api_url or "").port)} <= arguments


def _has_ended(pid: int) -> bool:
    """Whether a process is a zombie or gone, so that its files are closed; its command line disappears before."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0] in "ZX"
    except OSError:
        return True


def _listener(memory: Path) -> socket.socket:
    """Opens a listening socket at the last used port, so that bookmarks and workers keep working; else at a free one.

    Clients that connect wait until the server answers.
    """
    others = [*random.SystemRandom().sample(_PORTS, 10), 0]
    try:
        tries = [int(memory.read_text())] * 10 + others
    except (OSError, ValueError):
        tries = others
    for port in tries:
        with suppress(OSError, OverflowError):
            listener = socket.create_server(("127.0.0.1", port))
            memory.write_text(str(listener.getsockname()[1]))
            return listener
        if port == tries[0]:
            time.sleep(0.1)  # a server that has just been killed closes it within moments
    raise LocalServerError("127.0.0.1 has no free port for the local Prefect server")


def _known_server(settings: Settings) -> ServerStatus:
    """Returns the server in the state file, whether it still runs or not; without a file one that does not run.

    A copied home has the state file of the home that it was copied from, whose server is not its own.
    """
    try:
        status = ServerStatus(**json.loads(_state_file(settings).read_text()))
    except (OSError, ValueError, TypeError):
        return ServerStatus(running=False)
    is_own = status.log in (None, str(server_folder(settings) / "server.log"))
    return status if is_own else ServerStatus(running=False)


def _state_file(settings: Settings) -> Path:
    return server_folder(settings) / "server.json"


@contextmanager
def _locked(settings: Settings) -> Iterator[None]:
    with (_state_file(settings).parent / "server.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
