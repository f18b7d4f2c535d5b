"""Command lines of container engines, docker and podman alike."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..schemas.run_programs import ComputeLimits

# A tool is started at the same moment as its container, which takes a while to be there.
_WAIT_AND_EXECUTE = (
    'until [ "$("$1" inspect --format "{{.State.Running}}" "$2" 2>/dev/null)" = true ]; do sleep 0.1; done; '
    'exec "$1" exec "$2" /bin/bash -c "$3"'
)


@dataclass(frozen=True)
class Mount:
    """A folder of this machine that a container sees."""

    source: Path
    target: str
    read_only: bool = False

    @property
    def option(self) -> str:
        """The value of the engine's option `-v`."""
        return f"{self.source}:{self.target}" + (":ro" if self.read_only else "")


@dataclass(frozen=True)
class Container:
    """A container to be run."""

    engine: str
    name: str
    image: str
    command: Sequence[str] = ()
    """Replaces the image's `CMD`; its `ENTRYPOINT` stays."""

    environment: Mapping[str, str] = field(default_factory=dict)
    mounts: Sequence[Mount] = ()
    limits: ComputeLimits = field(default_factory=ComputeLimits)


def run_argv(container: Container) -> list[str]:
    """Runs a container in the foreground, on the machine's network, and removes it at its end."""
    limits = container.limits
    argv = [container.engine, "run", "--rm", "--name", container.name, "--network", "host"]
    if limits.cpus is not None:
        argv += ["--cpus", str(limits.cpus)]
    if limits.memory_bytes is not None:
        argv += ["--memory", str(limits.memory_bytes)]
    if limits.processes is not None:
        argv += ["--pids-limit", str(limits.processes)]
    if limits.gpu:
        argv += ["--gpus", "all"]
    for name, value in sorted(container.environment.items()):
        argv += ["-e", f"{name}={value}"]
    for mount in container.mounts:
        argv += ["-v", mount.option]
    return [*argv, container.image, *container.command]


def tool_argv(container: Container, command: str) -> list[str]:
    """Runs a command line beside what a container runs, as soon as it does."""
    return ["/bin/bash", "-c", _WAIT_AND_EXECUTE, "tool", container.engine, container.name, command]


def remove_argv(container: Container) -> list[str]:
    """Ends a container, whatever it does."""
    return [container.engine, "rm", "-f", container.name]
