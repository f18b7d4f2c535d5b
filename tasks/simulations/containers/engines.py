"""Container engines (docker, podman) of this machine: finding one, pulling and inspecting images."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.errors import LaunchError

ENGINE_VARIABLE = "ROBOMAKER_CONTAINER_ENGINE"
CREATE_TIMEOUT_S = 120.0
_ENGINES = ("docker", "podman")
_ANSWER_TIMEOUT_S = 20.0
_PULL_TIMEOUT_S = 1800.0
_POLL_S = 0.1
_KEPT_VARIABLES = ("PATH", "HOME", "XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "TMPDIR", "LANG")
# What the engine says is told last: where it has nothing to copy, tar complains too. Of what tar says the first line is
# told, and the rest is read, so that tar goes on.
_UNPACK = """
set -o pipefail
folder=$1 owners=$2
shift 2
case "$(tar --version 2>/dev/null)" in *"GNU tar"*) quiet=--warning=no-timestamp ;; *) quiet= ;; esac
unpack() {
  tar --extract --directory "$folder" --numeric-owner --preserve-permissions "--$owners-owner" $quiet 2>&1 >/dev/null |
    { head -n 1 >&2; cat >/dev/null; }
}
said=$({ "$@" 2>&3 | unpack; } 3>&1)
code=$?
echo "$said" >&2
[ $code = 0 ] && [ $owners = no-same ] && chmod -R a+rwX "$folder"
exit $code
"""
_CONTAINERD_STORE = "io.containerd.snapshotter.v1"
_KEPT_BEGINNINGS = ("DOCKER_", "CONTAINER_", "CONTAINERS_", "REGISTRY_")

Which = Callable[[str], str | None]
"""Function that finds a program on the path."""


class EngineError(Exception):
    """Raised when the container engine refuses a command or does not answer; contains its last message."""


class NameTakenError(EngineError):
    """Raised when a container was not created because another one has its name."""


@dataclass(frozen=True)
class Engine:
    """A container engine, docker or podman.

    Args:
        program: Path of the engine's executable.
        environment: Environment variables of its calls.
        is_podman: Whether it is podman, even if the executable is called docker.
        instead_of: Reason why another engine was not used, as text.
    """

    program: str
    environment: Mapping[str, str]
    is_podman: bool = False
    instead_of: str = ""

    def call(
        self,
        *arguments: str,
        timeout_s: float = _ANSWER_TIMEOUT_S,
        stopped: Callable[[], bool] = lambda: False,
        through: Sequence[str] = (),
    ) -> str:
        """Runs a command of the container engine, and returns what it printed.

        Args:
            arguments: Command and its arguments.
            timeout_s: Time limit in seconds.
            stopped: Function called several times a second; true cancels the command.
            through: Command line that wraps the engine's command line.

        Raises:
            EngineError: The command failed, took too long, or was `stopped`.
        """
        try:
            process = subprocess.Popen(
                [*through, self.program, *arguments],
                env=dict(self.environment),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                start_new_session=True,
            )
        except OSError as error:
            raise EngineError(f"{self.program} cannot be run: {error.strerror}") from error
        return _finish(process, arguments[0], timeout_s, stopped)


@dataclass(frozen=True)
class Image:
    """A container image on this machine, as its engine describes it."""

    id: str | None
    """Id of the image in the engine, independent of names: a SHA-256 in hexadecimal."""

    digests: tuple[str, ...]
    """Digests (`sha256:…`) of the image's manifest, one for each registry."""

    is_built_here: bool
    """Whether the image was built on this machine, as far as its digests tell."""

    volumes: tuple[str, ...]
    ports: tuple[str, ...]

    environment: Mapping[str, str]
    """Environment variables of the image (`ENV`)."""


def engine_environment(environ: Mapping[str, str]) -> dict[str, str]:
    """Returns this process's variables that a container engine needs (its address and credentials)."""
    return {
        name: value for name, value in environ.items() if name in _KEPT_VARIABLES or name.startswith(_KEPT_BEGINNINGS)
    }


def find_engine(environ: Mapping[str, str], which: Which) -> Engine:
    """Finds the container engine that a variable names, or the first of docker and podman that answers.

    Args:
        environ: Environment variables; `ROBOMAKER_CONTAINER_ENGINE` names an engine.
        which: Function that finds a program on the path.

    Raises:
        LaunchError: No container engine is installed, or none answers; the message has the answer of each.
    """
    named = environ.get(ENGINE_VARIABLE)
    said = []
    for name in (named,) if named else _ENGINES:
        if (program := which(name)) is None:
            said.append(f"{name} is not installed")
            continue
        engine = Engine(program, engine_environment(environ))
        try:
            engine.call("version")
            # Some systems have podman under the name of docker.
            is_podman = "podman" in engine.call("--version").lower()
            return replace(engine, is_podman=is_podman, instead_of="; ".join(said))
        except EngineError as error:
            said.append(f"{name} does not answer ({error})")
    raise LaunchError(
        f"container images need docker or podman, and this machine has none that works: {'; '.join(said)}; "
        f"install one, or say with {ENGINE_VARIABLE} where it is"
    )


def get_image(
    engine: Engine,
    uri: str,
    role: ApplicationRole,
    *,
    digest: str | None,
    stopped: Callable[[], bool] = lambda: False,
) -> Image:
    """Pulls a container image if necessary, checks that a job may run it, and returns its description.

    An image that was built on this machine is not pulled: its name in a registry may be another image. If the engine
    cannot tell where an image is from, this holds for all local images without a registry in their name. A local image
    that is named by its digest is not pulled either. A local image is used if the registry does not answer or does not
    have it.

    Args:
        engine: The container engine that pulls the image.
        uri: Name of the image.
        role: Role of the application, for failure codes.
        digest: Expected digest of the image; `None`: the one that the name refers to now.
        stopped: Function called several times a second; true cancels the pull.

    Raises:
        LaunchError: The image cannot be pulled, differs from the one of the application's version, or breaks the rules
            for images.
    """
    if uri.startswith("-"):  # an option, to an engine
        raise LaunchError(f"{uri!r} is no image; give a name such as my/robot:1.0")
    code = role.capitalize()
    image = _inspect(engine, uri)
    if image is None or not ("@" in uri or (digest is None and _may_be_built_here(engine, uri, image))):
        try:
            engine.call("pull", uri, timeout_s=_PULL_TIMEOUT_S, stopped=stopped)
        except EngineError as error:
            if image is None:
                why = f" ({engine.program} was asked because {engine.instead_of})" if engine.instead_of else ""
                raise LaunchError(
                    f"the image {uri} cannot be pulled: {error}{why}", f"BadPermissions{code}Application"
                ) from error
        image = _inspect(engine, uri)
    if image is None:
        raise LaunchError(f"the image {uri} is not there after it was pulled", f"BadPermissions{code}Application")
    if digest is not None and digest not in image.digests:
        found = ", ".join(image.digests) or "no digest: it was built here"
        raise LaunchError(
            f"the image {uri} has changed since the version was made: {digest}, then {found}",
            f"{code}ApplicationVersionMismatchedEtag",
        )
    for instruction, values in (("VOLUME", image.volumes), ("EXPOSE", image.ports)):
        if values:
            raise LaunchError(
                f"the image {uri} has {instruction} {' '.join(values)}, which jobs do not allow; remove it from the "
                "Dockerfile (ports are opened with portForwardingConfig)"
            )
    return image


def copy_out(
    engine: Engine,
    uri: str,
    name: str,
    folders: Mapping[str, Path],
    *,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Copies folders of a container image to this machine; missing ones are left out.

    A folder that is mounted over a folder of an image hides its content, such as a workspace below `/home/robomaker`.
    For root, files keep their owners; for other users, and if podman does not tell the owners, all files belong to the
    caller, and the image's `USER` may write to them.

    Args:
        engine: The container engine that has the image.
        uri: Name of the image.
        name: Name of the temporary container.
        folders: Local folders by the paths in the image.
        stopped: Function called several times a second; true cancels the copy.

    Raises:
        LaunchError: The engine refuses, or it was `stopped`.
    """
    owners = "same" if os.geteuid() == 0 and not engine.is_podman else "no-same"
    try:
        engine.call("create", "--name", name, "--network", "host", uri, "nothing", timeout_s=CREATE_TIMEOUT_S)
        try:
            for inside, here in folders.items():
                source, unpack = f"{name}:{inside}/.", ["/bin/bash", "-c", _UNPACK, "unpack", str(here), owners]
                try:
                    engine.call("cp", source, "-", timeout_s=_PULL_TIMEOUT_S, stopped=stopped, through=unpack)
                except EngineError as error:
                    if "o such" not in str(error) and "not find" not in str(error) and "not exist" not in str(error):
                        raise
        finally:
            engine.call("rm", "-f", name)
    except EngineError as error:
        raise LaunchError(f"the image {uri} cannot be looked into: {error}", "InternalServiceError") from error


def _inspect(engine: Engine, uri: str) -> Image | None:
    """Reads a container image's description (id, digests, ports, variables) from the engine of this machine.

    Returns `None` if the image is not on this machine or the engine fails.
    """
    try:
        found: dict[str, Any] = json.loads(engine.call("image", "inspect", uri))[0]
    except (EngineError, ValueError, LookupError):
        return None
    config = found.get("Config") or {}
    names: list[str] = found.get("RepoDigests") or []
    return Image(
        id=str(found.get("Id") or "").rpartition(":")[2] or None,  # podman leaves out that it is a SHA-256
        digests=tuple(name.rpartition("@")[2].lower() for name in names),
        is_built_here=all(name.startswith("localhost/") for name in names),  # as podman calls them
        volumes=tuple(config.get("Volumes") or ()),
        ports=tuple(config.get("ExposedPorts") or ()),
        environment=dict(each.split("=", 1) for each in config.get("Env") or () if "=" in each),
    )


def _may_be_built_here(engine: Engine, uri: str, image: Image) -> bool:
    """Whether an image may have been built on this machine, so that no registry has it.

    Docker with containerd's store gives all images digests, so there any image whose name has no registry may be. False
    if the engine fails.
    """
    first, separator, _ = uri.partition("/")
    names_registry = separator and (first == "localhost" or "." in first or ":" in first)
    if image.is_built_here or engine.is_podman or names_registry:
        return image.is_built_here
    try:
        return _CONTAINERD_STORE in engine.call("info", "--format", "{{.DriverStatus}}")
    except EngineError:
        return False


def _finish(process: "subprocess.Popen[str]", what: str, timeout_s: float, stopped: Callable[[], bool]) -> str:
    deadline = time.monotonic() + timeout_s
    while True:
        try:
            printed, complained = process.communicate(timeout=_POLL_S)
            break
        except subprocess.TimeoutExpired:
            late = time.monotonic() >= deadline
            if late or stopped():
                os.killpg(process.pid, signal.SIGKILL)  # with helpers, which have its output open too
                process.communicate()
                why = f"did not end within {timeout_s:g} s" if late else "was stopped"
                raise EngineError(f"`{what}` {why}") from None
    if process.returncode:
        last = (complained.strip() or printed.strip() or f"exit code {process.returncode}").splitlines()[-1]
        # docker: The container name "/x" is already in use by container …; podman: … that name is already in use
        raise (NameTakenError if "name" in last and "already in use" in last else EngineError)(last)
    return printed
