"""A real container engine: one that answers, else a docker daemon of the tests' own, else podman; without a network."""

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from container_images import write_root

_START_WITHIN_S = 30.0
_STOP_WITHIN_S = 20.0
_CALL_WITHIN_S = 60.0


class NoEngineError(Exception):
    """An engine cannot run containers here; says why."""


@dataclass(frozen=True)
class RealEngine:
    """An engine that runs containers.

    Args:
        program: its path.
        environ: the environment variables by which it is found, for whoever performs jobs.
        roots: where root file systems of images are kept.
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
        done = subprocess.run(
            [self.program, *arguments],
            env={**os.environ, **self.environ},
            capture_output=True,
            text=True,
            timeout=_CALL_WITHIN_S,
            check=False,
        )
        if done.returncode:
            raise NoEngineError(
                f"{Path(self.program).name} {arguments[0]}: {done.stderr.strip() or done.stdout.strip()}"
            )
        return done.stdout

    def add_image(self, *instructions: str, python: bool = False) -> str:
        """Makes an image; returns its name.

        Args:
            instructions: of a Dockerfile, such as `USER robo`.
            python: whether Python is in it.
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
            with suppress(NoEngineError):
                self.call("rmi", "-f", image)

    def containers(self, beginning: str) -> list[str]:
        """Names of all containers, running or not, that begin so."""
        names = self.call("ps", "-a", "--format", "{{.Names}}").split()
        return sorted(name for name in names if name.startswith(beginning))

    def check(self) -> None:
        """Runs a container.

        Raises:
            NoEngineError: that does not work.
        """
        self.call("run", "--rm", "--network", "host", self.add_image(), "id")


@pytest.fixture(scope="session")
def real_engine() -> Iterator[RealEngine]:
    """An engine that runs containers; skips where there is none."""
    reasons = []
    with tempfile.TemporaryDirectory(prefix="engine-") as name:
        folder = Path(name)
        for start in (_the_one_named, _docker_that_answers, _own_docker, _podman):
            with ExitStack() as stack:
                try:
                    engine = start(folder, stack)
                    stack.callback(engine.remove_images)
                    engine.check()
                except (NoEngineError, OSError, subprocess.TimeoutExpired) as error:
                    reasons.append(str(error))
                    continue
                yield engine
                return
    pytest.skip(f"no container engine works here: {'; '.join(reasons)}")


def _the_one_named(folder: Path, stack: ExitStack) -> RealEngine:
    del stack
    named = os.environ.get("ROBOMAKER_CONTAINER_ENGINE")
    if named is None:
        raise NoEngineError("ROBOMAKER_CONTAINER_ENGINE names none")
    return RealEngine(_found(named), _podman_settings(folder) if "podman" in named else {}, folder)


def _docker_that_answers(folder: Path, stack: ExitStack) -> RealEngine:
    del stack
    engine = RealEngine(_found("docker"), {}, folder)
    engine.call("version")
    return engine


def _own_docker(folder: Path, stack: ExitStack) -> RealEngine:
    """A daemon whose files are all in a folder; containers use the machine's network, so it needs none of its own."""
    if os.getuid() != 0:
        raise NoEngineError("dockerd can only be started as root")
    socket = f"unix://{folder}/docker.sock"
    program = _found("docker")
    command = [
        *(_found("unshare"), "--mount"),  # what it mounts is gone with it
        _found("dockerd"),
        *("--data-root", str(folder / "data"), "--exec-root", str(folder / "exec")),
        *("--host", socket, "--pidfile", str(folder / "docker.pid")),
        *("--iptables=false", "--ip-masq=false", "--bridge=none", "--storage-driver=vfs"),
    ]
    log = stack.enter_context((folder / "dockerd.log").open("wb"))
    daemon = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
    stack.callback(_stop, daemon)
    engine = RealEngine(program, {"DOCKER_HOST": socket}, folder)
    give_up_at = time.monotonic() + _START_WITHIN_S
    while True:
        try:
            engine.call("version")
        except NoEngineError as error:
            if daemon.poll() is not None or time.monotonic() > give_up_at:
                said = (folder / "dockerd.log").read_text(errors="replace").splitlines()[-1:]
                raise NoEngineError(f"dockerd does not start: {' '.join(said)}") from error
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


def _podman(folder: Path, stack: ExitStack) -> RealEngine:
    del stack
    return RealEngine(_found("podman"), _podman_settings(folder), folder)


def _podman_settings(folder: Path) -> dict[str, str]:
    """Settings that need as little as possible: no limits that this process may not set, images as plain folders."""
    settings = folder / "containers.conf"
    # podman itself lowers the number of processes to 32768 where it may not raise it.
    settings.write_text('[containers]\ndefault_ulimits = ["nofile=1024:1024", "nproc=1024:1024"]\n')
    if shutil.which("runc"):  # crun refuses control groups of which some are version 1 and some version 2
        settings.write_text(settings.read_text() + '[engine]\nruntime = "runc"\n')
    storage = folder / "storage.conf"
    storage.write_text(f'[storage]\ndriver = "vfs"\ngraphroot = "{folder}/podman"\nrunroot = "{folder}/podman-run"\n')
    return {"CONTAINERS_CONF": str(settings), "CONTAINERS_STORAGE_CONF": str(storage)}


def _found(name: str) -> str:
    program = shutil.which(name)
    if program is None:
        raise NoEngineError(f"{name} is not installed")
    return program
