"""Many agents of robots on this machine, each in a process of its own, with a disk and a clock of its own if wanted."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from helpers.agent_robot import AGENT
from helpers.machines_apart import apart
from helpers.package_installer import install_packages
from helpers.paths import REPOSITORY, TESTS
from helpers.processes import descendants, started
from helpers.required_programs import needs

NEEDS_COMPILER = needs("cc", shutil.which("cc"), "cc is not in PATH; robots have clocks of their own by a library in C")
"""Marks tests whose robots have clocks of their own."""

DAY_S = 86_400

_CLOCK = TESTS / "helpers" / "shifted_clock.c"
_OPTIONS = ("--health-s", "0.5", "--stop-s", "2", "--longest-wait-s", "1", "--sandbox", "none")
_ENROL_AND_RUN = """\
"$0" -m "$1" enroll --home "$2" --url "$3" --name "$4" "$5" && module=$1 home=$2 && shift 5 &&
exec "$0" -m "$module" run --home "$home" "$@"
"""


@dataclass(frozen=True)
class LocalAgent:
    """An agent that runs."""

    name: str
    home: Path
    log: Path
    process: "subprocess.Popen[str]"
    clock: Path | None = None
    """Has the seconds by which its clock is off; absent: it has the machine's."""

    @property
    def disk(self) -> Path:
        """Its home as it sees it: a file system of its own is not at that path for others."""
        return Path(f"/proc/{self.process.pid}/root{self.home}")

    @property
    def version(self) -> str | None:
        """The version that `current` leads to."""
        current = self.disk / "current"
        return current.readlink().name.partition("-")[0] if current.is_symlink() else None

    @property
    def runs(self) -> bool:
        """Whether an application runs."""
        return bool(descendants(self.process.pid))

    def set_clock(self, days: int) -> None:
        """Sets its clock that many days ahead of the machine's."""
        assert self.clock is not None
        self.clock.write_text(str(days * DAY_S))

    def fill_disk(self, free_bytes: int) -> None:
        """Leaves no more than some bytes of its disk free."""
        path = self.disk / "filler"
        with path.open("wb") as filler:
            try:
                while True:
                    filler.write(bytes(65_536))
                    filler.flush()
            except OSError:
                pass
        os.truncate(path, path.stat().st_size - free_bytes)

    def free_disk(self) -> None:
        """Takes the filler away."""
        (self.disk / "filler").unlink()

    def cpu_s(self) -> float:
        """Processor time of the agent and of all its children that have ended."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return sum(int(field) for field in fields[11:15]) / os.sysconf("SC_CLK_TCK")


@dataclass
class LocalAgents:
    """Agents that run until the end of a block."""

    folder: Path
    stack: ExitStack
    options: tuple[str, ...]
    agent: tuple[str, str]
    """Interpreter and module."""
    agents: dict[str, LocalAgent] = field(default_factory=dict[str, LocalAgent])

    def start(
        self, name: str, token: str, url: str, *, disk_mb: int | None = None, has_clock: bool = False
    ) -> LocalAgent:
        """Enrols a robot and runs its agent.

        Args:
            name: The robot's.
            token: Works once.
            url: Where it reaches the server.
            disk_mb: Size of a disk of its own, which nothing else sees; absent: a folder of this machine.
            has_clock: Whether its clock can be set.
        """
        home, log, clock = self.folder / name, self.folder / f"{name}.log", self.folder / f"{name}.clock"
        command = ["/bin/sh", "-c", _ENROL_AND_RUN, *self.agent, str(home), url, name, token]
        command += self.options
        if disk_mb is not None:
            home.mkdir()
            command = apart(command, home, home, size_mb=disk_mb)
        with log.open("w") as output:
            process = self.stack.enter_context(
                started(command, clock_environ(clock) if has_clock else {}, stdout=output, stderr=output)
            )
        self.agents[name] = LocalAgent(name, home, log, process, clock if has_clock else None)
        return self.agents[name]

    def versions(self) -> dict[str, str | None]:
        """The version of each robot that its `current` leads to."""
        return {name: agent.version for name, agent in self.agents.items()}


@contextmanager
def local_agents(
    folder: Path, *options: str, agent: tuple[str, str] = (sys.executable, AGENT)
) -> Iterator[LocalAgents]:
    """Agents for the block, with their homes and logs in a folder.

    Args:
        folder: The folder.
        *options: Of `run`; none: some that make it quick.
        agent: Interpreter and module.
    """
    folder.mkdir(exist_ok=True)
    with ExitStack() as stack:
        agents = LocalAgents(folder, stack, options or _OPTIONS, agent)
        try:
            yield agents
        finally:
            for each in agents.agents.values():
                each.process.terminate()  # killed, they would leave applications behind
            for each in agents.agents.values():
                with suppress(subprocess.TimeoutExpired):
                    each.process.wait(20)


def agent_as_on_robots(folder: Path) -> tuple[str, str]:
    """Interpreter and module of an agent that has nothing besides, as where only its wheel was installed."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    python = folder / "bin" / "python"
    install_packages("tuf>=6,<8", python=python)
    packages = next(folder.glob("lib/python3.*/site-packages"))
    (packages / "robomaker_agent").symlink_to(REPOSITORY / "tasks" / "fleet" / "agent")
    return str(python), "robomaker_agent"


def clock_environ(clock: Path, shift_s: int = 0) -> Mapping[str, str]:
    """Variables of a process whose clock is off by what the file says, some seconds at first."""
    library = clock.with_suffix(".so")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, _CLOCK, "-ldl"], check=True)
    clock.write_text(str(shift_s))
    return {"LD_PRELOAD": str(library), "SHIFTED_CLOCK": str(clock)}
