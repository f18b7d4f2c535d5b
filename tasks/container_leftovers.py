"""Containers of runs that are over: ended and removed, also by another performer than the one that made them.

Before a container is made its name is noted in the run's folder, so that none stays whoever is killed when.
"""

import json
import logging
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from ..schemas.simulation_run import ApplicationRole
from .container_argv import give_back_argv
from .containers import Engine, EngineError, engine_environment
from .shared_memory import remove_shared_memory
from .surroundings import container_sandbox

_NOTES = "containers.jsonl"
_REMOVE_TIMEOUT_S = 30.0
_GIVE_BACK_TIMEOUT_S = 120.0

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ContainerNote:
    """A container that a run has, or may have."""

    program: str
    """The engine's program."""

    name: str
    image: str
    role: ApplicationRole
    """Of its application."""


def note_container(folder: Path, note: ContainerNote) -> None:
    """Notes that a container is about to be made.

    Args:
      folder: the run's own folder.
      note: the container.
    """
    with (folder / _NOTES).open("a") as notes:
        notes.write(json.dumps(asdict(note)) + "\n")


def remove_containers_of_job(folder: Path) -> None:
    """Ends and removes the containers of all runs of a job; see `remove_containers`.

    Args:
      folder: the job's folder, in which its runs have theirs.
    """
    for run in folder.glob("*"):
        remove_containers(run)


def remove_containers(folder: Path, environ: Mapping[str, str] | None = None) -> list[str]:
    """Ends and removes the containers of a run; what they wrote belongs to this user afterwards, if that is possible.

    Args:
      folder: the run's own folder.
      environ: environment variables that say how engines are reached; absent: those of this process.

    Returns:
      What did not work, which is logged too: the run is over nevertheless.
    """
    environment = engine_environment(os.environ if environ is None else environ)
    notes, problems = _notes(folder), []
    for note in notes:
        try:
            Engine(note.program, environment).call("rm", "-f", note.name, timeout_s=_REMOVE_TIMEOUT_S)
        except EngineError as error:
            if "o such container" not in str(error):
                problems.append(f"container {note.name} cannot be removed: {error}")
    for note in {note.role: note for note in notes}.values():
        problems += _give_back(container_sandbox(folder, note.role).root, note, environment)
    if notes:
        remove_shared_memory(folder)
    for problem in problems:
        _logger.warning("%s", problem)
    (folder / _NOTES).unlink(missing_ok=True)
    return problems


def _give_back(root: Path, note: ContainerNote, environment: Mapping[str, str]) -> list[str]:
    """Engines that run as root let containers write files that only root may read or remove."""
    if os.geteuid() == 0 or not _has_files_of_others(root):
        return []
    argv = give_back_argv(note.program, f"{note.name}-files", note.image, root)
    try:
        Engine(note.program, environment).carry_out(argv, "run", _GIVE_BACK_TIMEOUT_S)
    except EngineError as error:
        return [
            f"files of the {note.role} application's container belong to another user, and what only that user may "
            f"read is not kept; the image {note.image} has no sh, chown and chmod to change that: {error}"
        ]
    return []


def _has_files_of_others(root: Path) -> bool:
    user = os.geteuid()
    for folder, folders, names in os.walk(root):
        for name in (*folders, *names):
            try:
                if Path(folder, name).lstat().st_uid != user:
                    return True
            except OSError:  # it is in a folder of somebody else's
                return True
    return False


def _notes(folder: Path) -> list[ContainerNote]:
    try:
        lines = (folder / _NOTES).read_text().splitlines()
    except OSError:
        return []
    return [ContainerNote(**json.loads(line)) for line in lines if line.endswith("}")]
