"""Debian's own `swupdate` as a robot: a process with a folder of its own, which polls a server of ours."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from helpers.processes import started, wait_for
from helpers.required_programs import needs

needs_swupdate = needs("swupdate", shutil.which("swupdate"), "swupdate is not installed")

_INSTALLED = """#!/bin/sh
# What swupdate starts once everything is installed; a health check would begin here.
touch "{marker}"
"""


@dataclass(frozen=True)
class SwupdateRobot:
    """A robot that runs swupdate."""

    process: subprocess.Popen[str]
    folder: Path
    """Its `TMPDIR`."""

    log: Path

    @property
    def marker(self) -> Path:
        """A file that is there once something was installed."""
        return self.folder / "installed"

    def wait_until_installed(self) -> None:
        """Waits for the marker, and takes it away."""
        wait_for(lambda: self.marker.exists() or self.process.poll() is not None, f"an installation; {self.log}")
        assert self.process.poll() is None, f"swupdate ended with {self.process.poll()}: {self.log.read_text()}"
        self.marker.unlink()

    def confirm(self, action_id: int, *, is_healthy: bool = True) -> str:
        """Says how an installed order works, as a health check on the robot does; returns what the program printed."""
        outcome = ["success", "closed", "health ok"] if is_healthy else ["failure", "closed", "health check failed"]
        status = "2" if is_healthy else "3"
        said = subprocess.run(
            ["swupdate-ipc", "sendtohawkbit", str(action_id), status, *outcome],
            env={**os.environ, "TMPDIR": str(self.folder)},
            check=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=200,
        )
        return said.stdout


@contextmanager
def swupdate_robot(
    name: str, token: str, port: int, certificate_pem: bytes, revision: str = "1.0"
) -> Iterator[SwupdateRobot]:
    """Starts a robot.

    Args:
        name: Id of the robot.
        token: Its token.
        port: Of the server, on this machine.
        certificate_pem: Whose bundles it installs.
        revision: Of its hardware.
    """
    # Not pytest's: sockets lie there, and their paths may have 107 characters.
    with tempfile.TemporaryDirectory(prefix="swu-", dir="/tmp") as short:
        folder = Path(short)
        robot_files = {"certificate.pem": certificate_pem, "installed.sh": _INSTALLED.encode()}
        for file, content in robot_files.items():
            (folder / file).write_bytes(content.replace(b"{marker}", bytes(folder / "installed")))
        (folder / "installed.sh").chmod(0o755)
        log = folder / "log"
        command = ["swupdate", "-l", "3", "-k", str(folder / "certificate.pem"), "-H", f"demo:{revision}"]
        command += ["-p", str(folder / "installed.sh")]
        command += ["-u", f"-t DEFAULT -u http://127.0.0.1:{port} -i {name} -k {token}"]
        # As under systemd, whose services ignore SIGPIPE. Where it is not ignored, swupdate dies of it in one of ten
        # cut downloads, since one of its threads writes to a socket that another one has closed.
        with (
            log.open("w") as output,
            started(
                command, {"TMPDIR": short}, stdout=output, stderr=subprocess.STDOUT, cwd=short, restore_signals=False
            ) as process,
        ):
            yield SwupdateRobot(process, folder, log)
