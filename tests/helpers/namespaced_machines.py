"""Machines of their own on this one: each has its own network, its own users' homes and its own names of hosts."""

import os
import pwd
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from helpers.processes import wait_for

_APART = ["unshare", "--net", "--mount", "--propagation", "private"]
_SCRIPT = """
ip link set lo up
mount --bind "$1/hosts" /etc/hosts
mount --bind "$1/passwd" /etc/passwd
for hidden in "${@:2}"; do mount -t tmpfs none "$hidden"; done
touch "$1/ready"
exec sleep infinity
"""


def _allowed() -> bool:
    """Whether networks can be made and entered: only the system's own administrator may do both."""
    with suppress(OSError):
        made = subprocess.run([*_APART, "ip", "link", "set", "lo", "up"], capture_output=True, check=False)
        return os.geteuid() == 0 and made.returncode == 0
    return False


NEEDS_NETWORKS = pytest.mark.skipif(not _allowed(), reason="this user may make no networks (that takes root)")
"""Marks tests whose machines have networks of their own."""


@dataclass(frozen=True)
class Machine:
    """A network in which nothing is but what the test starts there.

    Attributes:
        folder: Its files.
        pid: The process that keeps the network.
    """

    folder: Path
    pid: int
    _started: list[subprocess.Popen[Any]] = field(default_factory=list)

    @property
    def home(self) -> Path:
        """The home of its one user."""
        return self.folder / "home"

    def words(self, command: Sequence[str]) -> list[str]:
        """The words that run a command on it, from any other machine."""
        return ["nsenter", "--target", str(self.pid), "--net", "--mount", "--wd=.", *command]

    def start(
        self, command: Sequence[str], environ: Mapping[str, str], log: Path, **more: Any
    ) -> subprocess.Popen[Any]:
        """Starts a program that goes on until it ends, or the machine does; returns its process."""
        with log.open("ab") as output:
            process = subprocess.Popen(
                self.words(command), env=self._environ(environ), stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                start_new_session=True, **more,
            )  # fmt: skip
        self._started.append(process)
        return process

    def run(self, command: Sequence[str], environ: Mapping[str, str], **more: Any) -> subprocess.CompletedProcess[str]:
        """Runs a program to its end; what it has left in the background does not count."""
        written = self.folder / "written"
        with written.open("w") as output:
            done = subprocess.run(
                self.words(command), env=self._environ(environ), stdin=subprocess.DEVNULL, stdout=output,
                stderr=subprocess.STDOUT, text=True, check=False, **more,
            )  # fmt: skip
        return subprocess.CompletedProcess(done.args, done.returncode, written.read_text())

    def processes(self) -> set[int]:
        """All that runs there."""
        network = Path(f"/proc/{self.pid}/ns/net").readlink()
        found = set()
        for entry in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):  # it has ended
                if (entry / "ns" / "net").readlink() == network:
                    found.add(int(entry.name))
        return found

    def cut_power(self) -> None:
        """Ends all that runs there, at once."""
        for process in self.processes() - {self.pid}:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        for started in self._started:
            started.wait()

    def _environ(self, more: Mapping[str, str]) -> dict[str, str]:
        kept = {name: os.environ[name] for name in ("PATH", "LANG", "TZ") if name in os.environ}
        return {**kept, "HOME": str(self.home), **more}


@contextmanager
def namespaced_machine(folder: Path, hosts: Sequence[str] = (), hidden: Sequence[Path] = ()) -> Iterator[Machine]:
    """A machine; at the end it goes as a power cut would have it, with all that runs there.

    Args:
        folder: A new one, for its files.
        hosts: Names that lead to the machine itself.
        hidden: Folders that are there, and whose files it does not see: those of other machines.
    """
    (folder / "home").mkdir(parents=True, mode=0o700)
    (folder / "hosts").write_text("".join(f"127.0.0.1 {name}\n" for name in ("localhost", *hosts)))
    users = Path("/etc/passwd").read_text().splitlines(keepends=True)
    me = pwd.getpwuid(os.geteuid())
    moved = [line.replace(f":{me.pw_dir}:", f":{folder / 'home'}:") if line.startswith(f"{me.pw_name}:") else line
             for line in users]  # fmt: skip
    (folder / "passwd").write_text("".join(moved))
    keeper = subprocess.Popen([*_APART, "bash", "-ec", _SCRIPT, "bash", str(folder), *map(str, hidden)])
    try:
        wait_for((folder / "ready").exists, "the new network")
        machine = Machine(folder, keeper.pid)
        try:
            yield machine
        finally:
            machine.cut_power()
    finally:
        keeper.kill()
        keeper.wait()
