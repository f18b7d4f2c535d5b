"""Command lines for docker and podman, with the options that both share."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ....schemas.runs.programs import ComputeLimits
from .engines import Engine

# Not every client passes signals on, or ends as its container did; it has a group of its own (`set -m`), and what it
# cannot tell is asked for afterwards. That a container could start no more processes only its control group tells, and
# only while it runs.
_START = """
tell_of_processes() {
  local pid=0 place count
  while sleep 0.5 && kill -0 $$ 2>/dev/null; do
    pid=$("$1" inspect --format '{{.State.Pid}}' "$2" 2>/dev/null)
    [ "${pid:-0}" != 0 ] && break
  done
  place=$(sed -nE 's,^[0-9]*:pids:,/pids,p; s,^0::,,p' "/proc/$pid/cgroup" 2>/dev/null | head -n 1)
  while read -r _ count 2>/dev/null <"/sys/fs/cgroup$place/pids.events"; do
    if [ "$count" -gt 0 ]; then
      echo "the container could start no more than the $3 processes and threads that are allowed" >&2
      return
    fi
    sleep 0.5
  done
}
trap '"$1" kill --signal TERM "$2" >/dev/null 2>&1' TERM
set -m
"$1" start --attach "$2" &
main=$!
set +m
[ -n "$4" ] && tell_of_processes "$1" "$2" "$4" &
while wait $main; code=$?; kill -0 $main 2>/dev/null; do :; done
form='{{.State.Status}} {{.State.OOMKilled}} {{.State.ExitCode}}'
read -r status is_out_of_memory ended_with <<<"$("$1" inspect --format "$form" "$2" 2>/dev/null)"
case "$status:$ended_with" in exited:*|created:[1-9]*) code=$ended_with ;; esac
if [ "$is_out_of_memory" = true ]; then
  echo "the container used more memory than the $3 MiB that are allowed, and was killed" >&2
elif [ "$code" = 137 ]; then
  echo "the container was killed; perhaps it used more memory than the $3 MiB that are allowed" >&2
fi
exit $code
"""
# A tool is started at the same moment as its container, which takes a while to be there. When the container ends, it is
# killed, and that is noticed first; what it means is for the container's own end to say.
_RUN_TOOL = """
state() { "$1" inspect --format '{{.State.Status}}' "$2" 2>/dev/null; }
until now=$(state "$1" "$2"); [ "$now" = running ]; do
  case "$now" in exited|dead) exit 1 ;; esac
  sleep 0.1
done
"$1" exec "$2" /bin/bash -c "$3"
code=$?
if [ $code = 137 ]; then
  sleep 0.5
  [ "$(state "$1" "$2")" = running ] || sleep 10
fi
exit $code
"""
_REMOVE = 'exec "$1" rm -f "$2" >/dev/null'
# The owner of the folder has another number inside of rootless engines than outside.
_GIVE_BACK = 'chown -hR "$(stat -c %u:%g "$0")" "$0" && chmod -R u+rwX "$0"'
_GIVEN_BACK = "/robomaker"
# Engines read files line by line, with 64 KiB for a line.
_LONGEST_IN_FILE = 10_000

NO_PROGRAM = "/robomaker-no-such-program"
"""Path of a program that no image has."""


_WITHOUT = ("NET_RAW", "MKNOD")
"""Capabilities of a container's root user that no simulation needs and that are removed: with the machine's network,
the first reads all traffic; the second makes devices in folders that this machine sees.
"""

_SHARES = 1024
_SHARE_BY_NICE = 1.25
"""Factor by which the kernel lowers the weight of a process with each step of niceness."""
_LEAST_SHARES = 2


@dataclass(frozen=True)
class Mount:
    """A folder of this machine that is mounted into a container."""

    source: Path
    target: str
    read_only: bool = False

    @property
    def option(self) -> str:
        """Value of the container engine's option `--mount` for this folder."""
        values = ["type=bind", f"source={self.source}", f"target={self.target}"]
        line = io.StringIO()
        csv.writer(line, lineterminator="").writerow(values + ["readonly"] * self.read_only)
        return line.getvalue()


@dataclass(frozen=True)
class Container:
    """Settings of a container to be run: image, name, mounts, limits and command."""

    engine: Engine
    name: str
    image: str
    command: Sequence[str] = ()
    """Command that replaces the image's `CMD`; its `ENTRYPOINT` is kept."""

    environment: Mapping[str, str] = field(default_factory=dict)
    mounts: Sequence[Mount] = ()
    limits: ComputeLimits = field(default_factory=ComputeLimits)
    gpu: str = "0"
    """GPU of the container, if its limits give it one: number or UUID."""


def env_file(variables: Mapping[str, str]) -> str:
    """Returns the content of a file for the option `--env-file`: one variable per line, with unchanged values.

    Variables whose values do not fit in a line are left out.
    """
    return "".join(f"{name}={value}\n" for name, value in sorted(variables.items()) if _fits_line(value))


def _fits_line(value: str) -> bool:
    return not any(character in value for character in "\n\r\0") and len(value) < _LONGEST_IN_FILE


def cpu_shares(nice: int) -> int:
    """Returns the CPU shares of a container (1024 is normal) that correspond to a process's niceness."""
    return max(_LEAST_SHARES, round(_SHARES / _SHARE_BY_NICE**nice))


def create_arguments(container: Container, variables: Path) -> list[str]:
    """Returns the engine's arguments that create a container without starting it.

    The engine's log is off, as output is unlimited. Folders are not relabelled for SELinux, since the user who runs the
    job needs them, too.

    Args:
        container: Settings of the container.
        variables: Path of the file for `--env-file`; only variables that it cannot contain are in the arguments.
    """
    limits = container.limits
    options = {
        "--name": container.name,
        "--network": "host",
        "--log-driver": "none",
        "--security-opt": "label=disable",
        "--cpus": limits.cpus,
        **({"--cpu-shares": cpu_shares(limits.nice)} if limits.nice else {}),
        "--memory": limits.memory_bytes,
        "--memory-swap": limits.memory_bytes,  # memory and swap together; engines add as much again by default
        "--pids-limit": limits.processes,
        **(_gpu_option(container) if limits.gpu else {}),
        "--env-file": variables,
    }
    words = [*_words(options), *(word for name in _WITHOUT for word in ("--cap-drop", name))]
    for name, value in sorted(container.environment.items()):
        words += [] if _fits_line(value) else ["-e", f"{name}={value}"]
    for mount in container.mounts:
        words += ["--mount", mount.option]
    return ["create", *words, container.image, *container.command]


def gpu_probe_arguments(container: Container, name: str) -> list[str]:
    """Returns the engine's arguments that create an empty container with a GPU, to test whether that works."""
    options = {"--name": name, "--network": "none", **_gpu_option(container), "--entrypoint": NO_PROGRAM}
    return ["create", *_words(options), container.image]


def give_back_arguments(name: str, image: str, folder: Path) -> list[str]:
    """Returns the engine's arguments for a container that makes a folder's owner own all files in it.

    Args:
        name: Name of the temporary container.
        image: An image with a shell, `chown`, `chmod` and `stat`.
        folder: The folder.
    """
    options = {
        "--name": name,
        "--network": "none",
        "--security-opt": "label=disable",
        "--user": 0,
        "--mount": Mount(folder, _GIVEN_BACK).option,
        "--entrypoint": "/bin/sh",
    }
    return ["run", "--rm", *_words(options), image, "-c", _GIVE_BACK, _GIVEN_BACK]


def _gpu_option(container: Container) -> dict[str, str]:
    """Returns the option that gives a container its GPU.

    Docker calls NVIDIA's hook; podman reads the file that `nvidia-ctk cdi generate` wrote.
    """
    if container.engine.is_podman:
        return {"--device": f"nvidia.com/gpu={container.gpu}"}
    return {"--gpus": f"device={container.gpu}"}


def _words(options: Mapping[str, object]) -> list[str]:
    return [word for option, value in options.items() if value is not None for word in (option, str(value))]


def start_argv(container: Container) -> list[str]:
    """Returns the command line that starts a created container in the foreground.

    It reports whether the container ended for lack of memory, or could not start more processes.
    """
    mebibytes = round((container.limits.memory_bytes or 0) / 2**20)
    return _script(_START, container, str(mebibytes), str(container.limits.processes or ""))


def tool_argv(container: Container, command: str) -> list[str]:
    """Returns the command line that runs a tool inside a running container."""
    return _script(_RUN_TOOL, container, command)


def remove_argv(container: Container) -> list[str]:
    """Returns the command line that stops and removes a container."""
    return _script(_REMOVE, container)


def _script(script: str, container: Container, *arguments: str) -> list[str]:
    return ["/bin/bash", "-c", script, "container", container.engine.program, container.name, *arguments]
