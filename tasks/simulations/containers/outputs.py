"""Outputs of containers: written into folders of their own, put among the run's once all code has stopped."""

import logging
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.globs import Glob
from ..environment.folders import OUTPUT
from ..environment.run_environment import ROLES, container_sandbox
from ..outputs.upload_files import link_or_copy, visit_matches
from .cleanup import remove_containers

NOTES = "logs/outputs.log"
"""Log of the files that could not be kept, and why."""

_KEPT = f"{OUTPUT}.kept"
_ALL = Glob(f"{OUTPUT}/**")
_MOST_NOTES = 200

_logger = logging.getLogger(__name__)


def settle_containers(folder: Path, output_dir: Path) -> None:
    """Ends and removes the containers of a run that is over, and puts their outputs among its own.

    Args:
        folder: the run's own folder.
        output_dir: the run's outputs.
    """
    keep_outputs(folder, output_dir, remove_containers(folder))


def keep_outputs(folder: Path, output_dir: Path, problems: Sequence[str] = ()) -> None:
    """Moves what containers wrote as outputs to the run's own outputs; calling it again does no harm.

    Links are not followed. Nothing that is there is replaced: a second `result.json` becomes `result.json.1`.

    Args:
        folder: the run's own folder.
        output_dir: the run's outputs.
        problems: what else is to be noted in their log.
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
    """The path, or the first free one of `….1`, `….2`; `None` if a dead job worker has put the file there."""
    free, number = path, 0
    while os.path.lexists(free):
        if os.path.samestat(free.lstat(), file):
            return None
        number += 1
        free = path.with_name(f"{path.name}.{number}")
    return free
