"""A real container engine: one that is named or answers, else a docker daemon of the tests' own, else podman."""

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pytest

from helpers.container_images import write_root
from helpers.required_programs import missing
from prefect_robomaker.tasks.simulations.containers.engines import Engine, EngineError

_START_WITHIN_S = 200.0
_STOP_WITHIN_S = 20.0
_CALL_WITHIN_S = 200.0
_STORAGE_DRIVERS = ("overlay2", "vfs")
"""Storage drivers of the tests' own daemon; the second works on every file system, but copies all files each time."""


@dataclass(frozen=True)
class RealEngine:
    """An engine that runs containers.

    Args:
        program: Its path.
        environ: The environment variables by which it is found, for job workers.
        roots: Where root file systems of images are kept.
    """

    program: str
    environ: Mapping[str, str]
    roots: Path
    _archives: dict[bool, Path] = field(default_factory=dict)
    _made: dict[tuple[tuple[str, ...], bool], str] = field(default_factory=dict)
    _images: set[str] = field(default_factory=set)

    @property
    def prefix(self) -> str:
        """What the names of images and containers begin with: other tests may use the same engine."""
        return f"robomaker-tests-{os.getpid()}"

    @property
    def is_podman(self) -> bool:
        """Whether it is podman."""
        return "podman" in Path(self.program).name

    def call(self, *arguments: str) -> str:
        """Calls it; returns what it printed."""
        engine = Engine(self.program, {**os.environ, **self.environ})
        return engine.call(*arguments, timeout_s=_CALL_WITHIN_S)

    def add_image(self, *instructions: str, python: bool = False) -> str:
        """Makes an image; returns its name.

        Args:
            instructions: Of a Dockerfile, such as `USER robo`.
            python: Whether Python is in it.
        """
        if (instructions, python) not in self._made:
            image = self.note_image(f"{self.prefix}/image-{len(self._made)}:1")
            changes = [word for instruction in instructions for word in ("--change", instruction)]
            self.call("import", *changes, str(self.root(python=python)), image)
            self._made[instructions, python] = image
        return self._made[instructions, python]

    def root(self, *, python: bool = False) -> Path:
        """The archive of a root file system."""
        if python not in self._archives:
            self._archives[python] = self.roots / f"root-{python}.tar"
            write_root(self._archives[python], python=python)
        return self._archives[python]

    def note_image(self, name: str) -> str:
        """Has an image removed at the end; returns its name."""
        self._images.add(name)
        return name

    def remove_images(self) -> None:
        """Removes the images that it has been given, and that are there."""
        for image in sorted(self._images):
            with suppress(EngineError):
                self.call("rmi", "-f", image)

    def containers(self, beginning: str) -> list[str]:
        """Names of all containers, running or not, that begin so."""
        names = self.call("ps", "-a", "--format", "{{.Names}}").split()
        return sorted(name for name in names if name.startswith(beginning))


@pytest.fixture(scope="session")
def real_engine() -> Iterator[RealEngine]:
    """An engine that runs containers; skips where there is none."""
    reasons = []
    named = os.environ.get("ROBOMAKER_CONTAINER_ENGINE")
    with tempfile.TemporaryDirectory(prefix="engine-") as name:
        folder = Path(name)
        own = [partial(_own_docker, driver) for driver in _STORAGE_DRIVERS]
        starts = [partial(_docker, "docker"), *own, partial(_podman, "podman")]
        if named is not None:
            starts = [partial(_podman if "podman" in named else _docker, named)]
        for start in starts:
            with ExitStack() as stack:
                try:
                    engine = start(folder, stack)
                    stack.callback(engine.remove_images)
                    engine.call("run", "--rm", "--network", "host", engine.add_image(), "id")
                except (EngineError, OSError) as error:
                    reasons.append(str(error))
                    continue
                yield engine
                return
    reason = f"no container engine works here: {'; '.join(reasons)}"
    if not any(map(shutil.which, ("dockerd", "docker", "podman"))):
        missing("docker", reason)
    pytest.skip(reason)  # installed, but this machine lets no daemon run


def _docker(name: str, folder: Path, _: ExitStack) -> RealEngine:
    """One that answers."""
    engine = RealEngine(_found(name), {}, folder)
    engine.call("version")
    return engine


def _own_docker(driver: str, below: Path, stack: ExitStack) -> RealEngine:
    """A daemon whose files are all in a folder; containers use the machine's network, so it needs none of its own."""
    if os.getuid() != 0:
        raise EngineError("dockerd can only be started as root")
    folder = below / driver
    folder.mkdir()
    socket = f"unix://{folder}/docker.sock"
    command = [
        *(_found("unshare"), "--mount"),  # what it mounts is gone with it
        _found("dockerd"),
        *("--data-root", str(folder / "data"), "--exec-root", str(folder / "exec")),
        *("--host", socket, "--pidfile", str(folder / "docker.pid")),
        *("--iptables=false", "--ip-masq=false", "--bridge=none", f"--storage-driver={driver}"),
    ]
    log = stack.enter_context((folder / "dockerd.log").open("wb"))
    daemon = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
    stack.callback(_stop, daemon)
    engine = RealEngine(_found("docker"), {"DOCKER_HOST": socket}, folder)
    give_up_at = time.monotonic() + _START_WITHIN_S
    while True:
        try:
            engine.call("version")
        except EngineError as error:
            if daemon.poll() is not None or time.monotonic() > give_up_at:
                said = (folder / "dockerd.log").read_text(errors="replace").splitlines()[-1:]
                raise EngineError(f"dockerd does not start: {' '.join(said)}") from error
            time.sleep(0.1)
        else:
            return engine


def _stop(daemon: "subprocess.Popen[bytes]") -> None:
    daemon.terminate()
    try:
        daemon.wait(_STOP_WITHIN_S)
    except subprocess.TimeoutExpired:
        daemon.kill()
        daemon.wait()


def _podman(name: str, folder: Path, _: ExitStack) -> RealEngine:
    """One whose settings need as little as possible: no limits that this process may not set, plain folders."""
    program = _found(name)
    settings = folder / "containers.conf"
    # podman itself lowers the number of processes to 32768 where it may not raise it.
    settings.write_text('[containers]\ndefault_ulimits = ["nofile=1024:1024", "nproc=1024:1024"]\n')
    if shutil.which("runc"):  # crun refuses control groups of which some are version 1 and some version 2
        settings.write_text(settings.read_text() + '[engine]\nruntime = "runc"\n')
    storage = folder / "storage.conf"
    storage.write_text(f'[storage]\ndriver = "vfs"\ngraphroot = "{folder}/podman"\nrunroot = "{folder}/podman-run"\n')
    environ = {"CONTAINERS_CONF": str(settings), "CONTAINERS_STORAGE_CONF": str(storage)}
    return RealEngine(program, environ, folder)


def _found(name: str) -> str:
    program = shutil.which(name)
    if program is None:
        raise EngineError(f"{name} is not installed")
    return program
