"""What `deployments/compose.yaml` starts, as processes: no container engine, the same words, variables and order."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from helpers.namespaced_machines import Machine
from helpers.paths import REPOSITORY
from helpers.postgres_server import PROGRAMS, somebody
from helpers.processes import wait_for

SERVICES: dict[str, Any] = yaml.safe_load((REPOSITORY / "deployments" / "compose.yaml").read_text())
_DEFAULT = re.compile(r"\$\{\w+:-([^}]*)\}")
_READY_S = 900.0
"""A limit for what never comes: a busy machine takes ten times as long as an idle one."""


class ComposedServices:
    """The services on one machine, whose hosts are named like them.

    Args:
        machine: Where they run.
        folder: A new one that every user may enter, for what their containers would keep: PostgreSQL is not root.
    """

    NAMES = tuple(SERVICES["services"])

    def __init__(self, machine: Machine, folder: Path) -> None:
        self._machine = machine
        self._folder = folder
        self._processes: dict[str, subprocess.Popen[Any]] = {}

    def up(self) -> None:
        """Starts them as `docker compose up --detach` does: each when what it needs is there."""
        for name in self.NAMES:
            (self._folder / name).mkdir(parents=True)
        self._start_postgres()
        self._start("objects", TMPDIR=str(self._folder / "objects"))
        self._start("prefect", PREFECT_HOME=str(self._folder / "prefect"))
        self._await_health("prefect")
        made = self._machine.run(_words("setup"), self._environ("setup"), timeout=_READY_S)
        assert made.returncode == 0, made.stdout + self._logs()
        assert "RunJobWorker/machines  created" in made.stdout
        self._start("worker")

    def stop_worker(self) -> None:
        """Ends the worker of this machine, as `docker compose stop worker` does."""
        worker = self._processes["worker"]
        worker.send_signal(signal.SIGTERM)
        worker.wait(200)

    def _start(self, name: str, **more: str) -> None:
        words = [word.replace("-dir=/data", f"-dir={self._folder / name}") for word in _words(name)]
        environ = self._environ(name) | more
        self._processes[name] = self._machine.start(words, environ, self._log(name), cwd=self._folder / name)

    def _start_postgres(self) -> None:
        assert PROGRAMS is not None
        user, data, variables = somebody(), self._folder / "postgres", self._environ("postgres")
        for folder in (self._folder, data):
            shutil.chown(folder, user)
        as_user = ["setpriv", f"--reuid={user}", "--clear-groups"]
        name = variables["POSTGRES_USER"]
        made = self._machine.run(
            [*as_user, str(PROGRAMS / "initdb"), "-D", str(data / "data"), "-U", name, "--auth", "trust", "--no-sync"],
            variables,
        )
        assert made.returncode == 0, made.stdout
        server = [str(PROGRAMS / "postgres"), "-D", str(data / "data"), "-c", f"unix_socket_directories={data}"]
        self._machine.start([*as_user, *server, "-c", "fsync=off"], variables, self._log("postgres"))
        psql = [*as_user, str(PROGRAMS / "psql"), "-h", "127.0.0.1", "-U", name, "-d", "postgres", "-c"]
        wait_for(lambda: self._machine.run([*psql, "SELECT 1"], variables).returncode == 0, "PostgreSQL", _READY_S)
        for statement in (f"CREATE DATABASE {variables['POSTGRES_DB']}", SERVICES["configs"]["databases"]["content"]):
            done = self._machine.run([*psql, statement], variables)
            assert done.returncode == 0, done.stdout

    def _await_health(self, name: str) -> None:
        """Asks as the service's own check of health does, and as often: each question is a process of Python."""
        check = SERVICES["services"][name]["healthcheck"]
        interval_s = float(check["interval"].removesuffix("s"))

        def healthy() -> bool:
            time.sleep(interval_s)
            return self._machine.run(check["test"][1:], self._environ(name)).returncode == 0

        wait_for(healthy, f"{name}; {self._logs()}", _READY_S)

    def _environ(self, name: str) -> dict[str, str]:
        given: Mapping[str, str] = SERVICES["services"][name].get("environment", {})
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        home = {"HOME": str(self._folder / name), "PATH": path}
        return home | {key: _DEFAULT.sub(r"\1", value) for key, value in given.items()}

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _logs(self) -> str:
        return "\n".join(f"{log.name}: {log.read_text()[-2000:]}" for log in self._folder.glob("*.log"))


def _words(name: str) -> list[str]:
    service = SERVICES["services"][name]
    return [str(word) for word in (*service.get("entrypoint", ()), *service["command"])]
