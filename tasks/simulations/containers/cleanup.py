"""Containers of runs that are over: ended and removed, also by another worker than the one that made them.

Before a container is made its name is noted in the run's folder, so that none stays, whichever process is killed.
"""

import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.errors import LaunchError
from ..environment.folders import remove
from ..environment.run_environment import container_sandbox
from ..environment.shared_memory import remove_shared_memory
from .command_lines import give_back_arguments
from .engines import Engine, EngineError, NameTakenError, engine_environment

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
    """Role of its application."""


def note_container(folder: Path, note: ContainerNote) -> None:
    """Notes in the run's own folder that a container is about to be made."""
    with (folder / _NOTES).open("a") as notes:
        notes.write(json.dumps(asdict(note)) + "\n")


@contextmanager
def noted_container(folder: Path, note: ContainerNote, suffix: str = "") -> Iterator[str]:
    """Notes a container that is made inside the block; yields its name, which the suffix is added to.

    If another container had the name, the note is taken back: that one is not this run's to remove.
    """
    note = replace(note, name=note.name + suffix)
    note_container(folder, note)
    try:
        yield note.name
    except LaunchError as error:
        if isinstance(error.__cause__, NameTakenError):
            _keep_notes(folder, [each for each in _notes(folder) if each.name != note.name])
        raise


def remove_containers_of_job(folder: Path) -> None:
    """Ends and removes the containers of all runs that have folders in a job's folder."""
    for run in folder.glob("*"):
        remove_containers(run)


def remove_containers(folder: Path, environ: Mapping[str, str] | None = None) -> list[str]:
    """Ends and removes the containers of a run; what they wrote belongs to this user afterwards, if that is possible.

    Those that cannot be removed stay noted: see `has_containers`.

    Args:
        folder: the run's own folder.
        environ: environment variables that say how engines are reached; absent: those of this process.

    Returns:
        What did not work, which is logged too: the run is over nevertheless.
    """
    if not (notes := _notes(folder)):
        return []
    environment = engine_environment(os.environ if environ is None else environ)
    left: list[ContainerNote] = []
    problems: list[str] = []
    for note in notes:
        try:
            Engine(note.program, environment).call("rm", "-f", note.name, timeout_s=_REMOVE_TIMEOUT_S)
        except EngineError as error:
            if "o such container" not in str(error):
                left.append(note)
                problems.append(f"container {note.name} cannot be removed: {error}")
    for note in {note.role: note for note in notes}.values():
        try:
            _give_back(container_sandbox(folder, note.role).root, note, environment)
        except EngineError as error:
            problems.append(
                f"files of the {note.role} application's container belong to another user, and what only that user may "
                f"read is not kept; the image {note.image} has no sh, chown and chmod to change that: {error}"
            )
    problems += _free_shared_memory(folder, notes, environment)
    for problem in problems:
        _logger.warning("%s", problem)
    _keep_notes(folder, left)
    return problems


def has_containers(folder: Path) -> bool:
    """Whether a run has, or may have, containers that were not removed; its folder has to stay, to tell of them."""
    return bool(_notes(folder))


def remove_run(folder: Path) -> bool:
    """Removes the folder of a run, unless containers of it are left; returns whether it did."""
    if has_containers(folder):
        return False
    remove(folder)
    return True


def _free_shared_memory(folder: Path, notes: Sequence[ContainerNote], environment: Mapping[str, str]) -> list[str]:
    """Removes the memory that the containers of a run share; returns what stays of it."""
    left, said = remove_shared_memory(folder), ""
    for note, place in product({note.image: note for note in notes}.values(), left):
        try:
            _give_back(place, note, environment)
        except EngineError as error:
            said = f": {error}"
    left = left and remove_shared_memory(folder)
    return [f"{place}, which containers shared, cannot be removed{said}" for place in left]


def _give_back(root: Path, note: ContainerNote, environment: Mapping[str, str]) -> None:
    """Engines that run as root let containers write files that only root may read or remove.

    Raises:
        EngineError: the image does not have what is needed, or the engine does not answer.
    """
    if os.geteuid() == 0 or not _has_files_of_others(root):
        return
    arguments = give_back_arguments(f"{note.name}-files", note.image, root)
    Engine(note.program, environment).call(*arguments, timeout_s=_GIVE_BACK_TIMEOUT_S)


def _has_files_of_others(root: Path) -> bool:
    user = os.geteuid()
    try:
        return any(path.lstat().st_uid != user for path in root.rglob("*"))
    except (OSError, RecursionError):  # it may be in a folder of somebody else's
        return True


def _notes(folder: Path) -> list[ContainerNote]:
    try:
        lines = (folder / _NOTES).read_text().splitlines()
    except OSError:
        return []
    return [ContainerNote(**json.loads(line)) for line in lines if line.endswith("}")]


def _keep_notes(folder: Path, notes: Sequence[ContainerNote]) -> None:
    """Notes these containers and no others."""
    if not notes:
        (folder / _NOTES).unlink(missing_ok=True)
        return
    with suppress(OSError):  # too many are noted then, which does no harm
        fewer = folder / f"{_NOTES}.new"
        fewer.write_text("".join(json.dumps(asdict(note)) + "\n" for note in notes))
        fewer.rename(folder / _NOTES)
