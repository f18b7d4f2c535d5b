"""Removal of a job's containers after its run, keeping their outputs."""

import json
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.errors import LaunchError
from ....schemas.wire.globs import Glob
from ..environment.folders import OUTPUT, remove, remove_shared_memory
from ..environment.run_environment import ROLES, container_sandbox
from ..outputs.upload_files import link_or_copy, visit_matches
from .command_lines import give_back_arguments
from .engines import Engine, EngineError, NameTakenError, engine_environment

_NOTES = "containers.jsonl"
_REMOVE_TIMEOUT_S = 30.0
_GIVE_BACK_TIMEOUT_S = 120.0

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ContainerNote:
    """Record of a container that a run has created or will create, so that it can be removed after a crash."""

    program: str
    """Path of the container engine's program."""

    name: str
    image: str
    role: ApplicationRole
    """Role of the container's application."""


def note_container(folder: Path, note: ContainerNote) -> None:
    """Appends the record of a container that a run will create to a file in the run's folder, for its later removal."""
    with (folder / _NOTES).open("a") as notes:
        notes.write(json.dumps(asdict(note)) + "\n")


@contextmanager
def noted_container(folder: Path, note: ContainerNote, suffix: str = "") -> Iterator[str]:
    """Records on disk a container that is created inside the `with` block, for its removal; yields its suffixed name.

    If another container had the name already, the record is deleted, as that container is not this run's to remove; the
    error is raised again.
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
    """Stops and removes the containers of all of a job's runs."""
    for run in folder.glob("*"):
        remove_containers(run)


def remove_containers(folder: Path, environ: Mapping[str, str] | None = None) -> list[str]:
    """Stops and removes the containers of a run, and makes this user the owner of their files.

    Containers that cannot be removed stay recorded: see `has_containers`.

    Args:
        folder: Folder of the run.
        environ: Environment variables with the container engine's address; absent: those of this process.

    Returns:
        Error texts, which are logged, too; the run is over nevertheless.
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
    """Returns whether a run may have containers that were not removed; its folder must then be kept."""
    return bool(_notes(folder))


def remove_run(folder: Path) -> bool:
    """Deletes the folder of a run, unless it may have containers left; returns whether it was deleted."""
    if has_containers(folder):
        return False
    remove(folder)
    return True


def _free_shared_memory(folder: Path, notes: Sequence[ContainerNote], environment: Mapping[str, str]) -> list[str]:
    """Deletes the shared memory of a run's containers, and returns an error text for each folder that stays.

    Folders that root made in a container are given to this user by a container of the same image first.
    """
    left, said = remove_shared_memory(folder), ""
    for note, place in product({note.image: note for note in notes}.values(), left):
        try:
            _give_back(place, note, environment)
        except EngineError as error:
            said = f": {error}"
    left = left and remove_shared_memory(folder)
    return [f"{place}, which containers shared, cannot be removed{said}" for place in left]


def _give_back(root: Path, note: ContainerNote, environment: Mapping[str, str]) -> None:
    """Makes this user the owner of files that a container wrote as root, which could not be deleted otherwise.

    Does nothing if this user is root, or all files are this user's own.

    Raises:
        EngineError: The image does not have what is needed, or the engine does not answer.
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
    """Replaces the stored list of a run's containers; an empty list deletes the file.

    A failure is ignored: too many are noted then, which does no harm.
    """
    if not notes:
        (folder / _NOTES).unlink(missing_ok=True)
        return
    with suppress(OSError):  # too many are noted then, which does no harm
        fewer = folder / f"{_NOTES}.new"
        fewer.write_text("".join(json.dumps(asdict(note)) + "\n" for note in notes))
        fewer.rename(folder / _NOTES)


NOTES = "logs/outputs.log"
"""Path of the log with the files that could not be kept, and the reasons."""

_KEPT = f"{OUTPUT}.kept"
_ALL = Glob(f"{OUTPUT}/**")
_MOST_NOTES = 200


def settle_containers(folder: Path, output_dir: Path) -> None:
    """Stops and removes the containers of a finished run, and moves their outputs to the run's outputs.

    Args:
        folder: Folder of the run.
        output_dir: Folder of the run's outputs.
    """
    keep_outputs(folder, output_dir, remove_containers(folder))


def keep_outputs(folder: Path, output_dir: Path, problems: Sequence[str] = ()) -> None:
    """Moves files that containers wrote as outputs to the run's outputs; safe to repeat.

    Links are not followed. Existing files are not replaced: a second `result.json` becomes `result.json.1`.

    Args:
        folder: Folder of the run.
        output_dir: Folder of the run's outputs.
        problems: Further problems to write to the log.
    """
    notes = list(problems)
    for role in ROLES:
        sandbox = container_sandbox(folder, role)
        visit_matches(sandbox.root, _ALL, _mover(role, output_dir, notes))
        with suppress(FileNotFoundError):  # what cannot be taken away is not to be found a second time
            sandbox.place(OUTPUT).rename(sandbox.place(_KEPT))
    if notes:
        try:
            (output_dir / NOTES).parent.mkdir(exist_ok=True)
            with (output_dir / NOTES).open("a") as log:
                log.write("\n".join(notes[:_MOST_NOTES]) + "\n")
        except OSError as error:
            _logger.warning("%s cannot be written in %s: %s", NOTES, output_dir, error)


def _mover(role: ApplicationRole, output_dir: Path, notes: list[str]) -> Callable[[int, str, str], None]:
    def visit(descriptor: int, name: str, below: str) -> None:
        try:
            free = _free(output_dir / below, os.stat(name, dir_fd=descriptor, follow_symlinks=False))
            if free is not None:
                link_or_copy(descriptor, name, free)
        except OSError as error:
            notes.append(f"{OUTPUT}/{below} of the {role} application's container is not kept: {error}")
            return
        with suppress(OSError):  # it goes with the folder
            os.unlink(name, dir_fd=descriptor)

    return visit


def _free(path: Path, file: os.stat_result) -> Path | None:
    """Returns the path, or the first free one of `….1`, `….2`; `None` if a dead job worker moved this file already."""
    free, number = path, 0
    while os.path.lexists(free):
        if os.path.samestat(free.lstat(), file):
            return None
        number += 1
        free = path.with_name(f"{path.name}.{number}")
    return free
