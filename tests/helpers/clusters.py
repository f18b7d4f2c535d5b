"""Clusters of real processes on this machine, whose machines have homes of their own."""

import os
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property
from pathlib import Path
from subprocess import STDOUT, Popen
from typing import Any

from helpers.machines_apart import apart
from helpers.processes import alive, descendants, started, wait_for, working_below

_MISSING = "No module named 'prefect_robomaker'"


class Cluster:
    """A head, and machines that are added to it.

    Args:
        folder: Where they keep what they write.
        variables: Where catalog and object store are.
    """

    def __init__(self, folder: Path, variables: Mapping[str, str]) -> None:
        self._folder = folder
        self._variables = variables
        self._stack = ExitStack()
        self._machines: dict[str, Popen[str]] = {}
        self.backend = ""
        """What `ROBOMAKER_BACKEND` is set to for it."""
        self.hidden: Path | None = None
        """A folder above all homes that machines do not see, but for their own home; None: they see all."""

    def start_head(self, port: int = 0) -> "Popen[str]":
        """Starts what the machines connect to, and waits until it answers."""
        raise NotImplementedError

    def add(self, name: str, **variables: str) -> None:
        """Adds a machine that runs one job at once, and waits until it has joined."""
        raise NotImplementedError

    def restart_head(self) -> None:
        """Kills the head, and starts it again where it was."""
        raise NotImplementedError

    def remains(self) -> list[str]:
        """What the cluster has of its clients and their tasks, in its own words."""
        raise NotImplementedError

    def without_package(self) -> dict[str, str]:
        """Variables of a process that does not find the package of ours."""
        package = self._folder / "hidden" / "prefect_robomaker"
        package.mkdir(parents=True, exist_ok=True)
        (package / "__init__.py").write_text(f"raise ModuleNotFoundError({_MISSING!r})\n")
        return {"PYTHONPATH": str(package.parent)}

    def home(self, name: str) -> Path:
        """The home of a machine."""
        return self._folder / name

    def await_job_on(self, name: str) -> None:
        """Waits until a simulation runs on a machine."""
        wait_for(lambda: working_below(self.home(name)), f"a job to run on {name}", 120)

    def log(self, name: str) -> str:
        """What a machine has written."""
        return (self._folder / f"{name}.txt").read_text(errors="replace")

    def kill(self, name: str) -> None:
        """Kills the cluster's processes on a machine; ours are left to themselves."""
        os.killpg(self._machines.pop(name).pid, signal.SIGKILL)

    def kill_all_of(self, name: str) -> None:
        """Kills all that runs on a machine, as when its power fails."""
        ours = of_home(self.home(name))
        self.kill(name)
        for pid in ours:
            with suppress(ProcessLookupError):  # some end with the cluster's
                os.kill(pid, signal.SIGKILL)

    def close(self) -> None:
        """Kills all of it."""
        self._stack.close()

    def run(self, name: str, *command: str, **variables: str) -> "Popen[str]":
        """Starts a process of a machine."""
        output = self._stack.enter_context((self._folder / f"{name}.txt").open("w"))
        environ = {**self._variables, "ROBOMAKER_HOME": str(self.home(name)), **variables}
        words = [sys.executable, "-m", *command]
        if self.hidden is not None and name != "head":
            words = apart(words, self.hidden, self.home(name))
        process = self._stack.enter_context(started(words, environ, stdout=output, stderr=STDOUT, cwd=self._folder))
        self._machines[name] = process
        return process


class DaskCluster(Cluster):
    """A scheduler, and Dask workers of one thread under nannies."""

    address: str

    def start_head(self, port: int = 0) -> "Popen[str]":
        command = ("dask", "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        process = self.run("head", *command, **self.without_package())

        def announced() -> str:
            return next((word for word in self.log("head").split() if word.startswith("tcp://127.0.0.1:")), "")

        self.address = wait_for(announced, "Dask's scheduler")
        self.backend = f"dask:{self.address}"
        return process

    def restart_head(self) -> None:
        self.kill("head")
        self.start_head(int(self.address.rpartition(":")[2]))

    def remains(self) -> list[str]:
        from distributed import Client

        def ask(dask_scheduler: Any) -> list[str]:
            clients = [name for name in dask_scheduler.clients if name.startswith("robomaker")]
            return [*clients, *map(str, dask_scheduler.tasks)]

        with Client(self.address, set_as_default=False) as client:
            answer: Any = client.run_on_scheduler(ask)
        return list(answer)

    def add(self, name: str, **variables: str) -> None:
        command = ("dask", "worker", self.address, "--name", name, "--nthreads", "1", "--no-dashboard")
        own = {"DASK_TEMPORARY_DIRECTORY": str(self._folder / "dask"), **variables}
        self.run(name, *command, "--host", "127.0.0.1", **own)
        wait_for(lambda: "Registered to" in self.log(name), f"{name} to join", 120)


class RayCluster(Cluster):
    """A head without processors, and nodes with one."""

    _port: int

    def start_head(self, port: int = 0) -> "Popen[str]":
        self._port = port or _free_port()
        self.address = f"127.0.0.1:{self._port}"
        self.client_port = _free_port()
        options = ("--include-dashboard", "false", "--ray-client-server-port", str(self.client_port))
        self._start("head", 0, "--head", "--port", str(self._port), *options)
        self.backend = f"ray:{self.address}"
        return self._machines["head"]

    def restart_head(self) -> None:
        self.kill("head")
        self.start_head(self._port)

    def add(self, name: str, **variables: str) -> None:
        self._start(name, 1, "--address", self.address, **variables)

    def remains(self) -> list[str]:
        """Its own list of tasks needs its dashboard: processes of ours are looked for instead."""
        return []

    def close(self) -> None:
        super().close()
        if "RAY_TMPDIR" in self._own:
            shutil.rmtree(self._own["RAY_TMPDIR"], ignore_errors=True)

    @cached_property
    def _own(self) -> dict[str, str]:
        # Its folder has sockets, whose paths may not be long.
        return {"RAY_TMPDIR": tempfile.mkdtemp(prefix="ray", dir="/tmp")}

    def _start(self, name: str, cpus: int, *options: str, **variables: str) -> None:
        """Starts a node; on a busy machine its parts may not find each other in time."""
        common = ("--block", "--disable-usage-stats", "--node-ip-address", "127.0.0.1")
        limits = ("--num-cpus", str(cpus), "--object-store-memory", "80000000")
        # Ray's own fixed ports may be those of another node, or the free one that a head was given: 0 is any.
        ports = ("--dashboard-agent-listen-port", "0", "--min-worker-port", "0", "--max-worker-port", "0")
        for _ in range(3):
            command = ("ray.scripts.scripts", "start", *common, *limits, *ports, *options)
            node = self.run(name, *command, **self._own, **variables)
            wait_for(lambda node=node: "will now block" in self.log(name) or node.poll() is not None, f"{name}", 120)
            if node.poll() is None:
                return
        raise AssertionError(self.log(name))


KINDS: dict[str, type[Cluster]] = {"dask": DaskCluster, "ray": RayCluster}


@contextmanager
def cluster_of(kind: str, folder: Path, variables: Mapping[str, str]) -> Iterator[Cluster]:
    """Has a cluster without machines inside the block."""
    folder.mkdir()
    cluster = KINDS[kind](folder, variables)
    try:
        cluster.start_head()
        yield cluster
    finally:
        cluster.close()


def of_home(home: Path) -> set[int]:
    """Processes of ours on the machine that has a home: its job worker, and what that has started."""
    found: set[int] = set()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            environ = (entry / "environ").read_bytes().split(b"\0")
        except OSError:
            continue  # it has ended, or belongs to somebody else
        if b"prefect_robomaker" in words and b"work" in words and f"ROBOMAKER_HOME={home}".encode() in environ:
            found |= {int(entry.name), *descendants(int(entry.name))}
    return alive(found)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
