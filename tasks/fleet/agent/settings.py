"""Settings of the robot agent: its connection to the server, how it runs applications, and the folders of its home."""

from __future__ import annotations

import json
import platform
import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from .deployment import ARCHITECTURES
from .errors import AgentError
from .journal import write_durably

DEFAULT_HOME = "/var/lib/robomaker-agent"

_ROBOT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,254}")


@dataclass(frozen=True)
class Connection:
    """Connection data of a robot: name, token, and the server's address."""

    url: str
    """Address of the update server: scheme, name and port."""

    tenant: str
    robot: str
    token: str

    @property
    def base(self) -> str:
        """URL path of this robot at the update server."""
        return f"/{self.tenant}/controller/v1/{self.robot}"


@dataclass(frozen=True)
class Options:
    """Options of the agent: time limits, sandbox and health command."""

    user: str | None = None
    """User that runs applications and scripts; `None`: the agent's own user."""

    sandbox: str = "auto"
    """Sandbox program: `bwrap`, `setpriv`, `none`; `auto`: the first of these that works on this machine."""

    architecture: str | None = None
    """Architecture by RoboMaker's name (`X86_64`, `ARM64`, `ARMHF`); `None`: that of the machine."""

    health_s: float = 10.0
    """Time for which a new version must keep running to count as healthy, in seconds."""

    health_command: str | None = None
    """Shell command that runs after that time; exit code 0 means that the version is healthy."""

    script_timeout_s: float = 600.0
    """Time limit for each condition file, preLaunchFile, postLaunchFile and health command, in seconds."""

    stop_s: float = 10.0
    """Time within which an application must end when asked to, before it is killed, in seconds."""

    longest_wait_s: float = 300.0
    """Longest pause between two polls while the server is away, in seconds."""


class Home:
    """Folders and files of the agent on the robot.

    Args:
        folder: Absent ones are made when they are needed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self.connection_file = self.folder / "agent.json"
        self.root_file = self.folder / "root.json"
        self.metadata = self.folder / "metadata"
        self.downloads = self.folder / "downloads"
        self.versions = self.folder / "versions"
        self.current = self.folder / "current"
        self.logs = self.folder / "logs"

    def connection(self) -> Connection:
        """Reads the robot's connection data from `agent.json`.

        Raises:
            AgentError: The robot is not enrolled, or the file is invalid.
        """
        try:
            content = json.loads(self.connection_file.read_bytes())
            return Connection(**content)
        except FileNotFoundError:
            raise AgentError(f"{self.folder} has no agent.json: enroll this robot first") from None
        except (ValueError, TypeError) as error:
            raise AgentError(f"{self.connection_file} is not right: {error}; enroll again with --again") from None

    def save_connection(self, connection: Connection) -> None:
        """Stores the robot's connection data, readable only by the agent's user."""
        write_durably(self.connection_file, json.dumps(asdict(connection)).encode())


def checked_connection(url: str, tenant: str, robot: str, token: str) -> Connection:
    """Makes validated connection data.

    Raises:
        AgentError: The URL, tenant or robot name is invalid; the message names it.
    """
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname or parts.path.strip("/") or parts.query:
        raise AgentError(f"--url: {url!r} is not right; scheme, name and port are, such as https://fleet.example.com")
    for name, value in (("--tenant", tenant), ("--name", robot)):
        if not _ROBOT.fullmatch(value):
            raise AgentError(f"{name}: {value!r} is not right; letters, digits, '.', '_' and '-' are")
    return Connection(url.rstrip("/"), tenant, robot, token)


def checked_options(options: Options) -> Options:
    """Validates options, and fills in this machine's architecture.

    Raises:
        AgentError: An option is invalid; the message names it.
    """
    known = sorted(set(ARCHITECTURES.values()))
    architecture = options.architecture or ARCHITECTURES.get(platform.machine().lower())
    if architecture not in known:
        shown = options.architecture or platform.machine()
        raise AgentError(f"--architecture: {shown!r} is not right; one of {', '.join(known)} is")
    numbers: dict[str, Any] = {name: value for name, value in asdict(options).items() if name.endswith("_s")}
    for name, value in numbers.items():
        if not 0 <= value <= 86400:
            raise AgentError(f"--{name.replace('_', '-')}: {value:g} is not right; 0 to 86400 seconds are")
    return replace(options, architecture=architecture)
