"""Programs that this machine has, and that a confined run missed since its box does not show them."""

import os
import re
from contextlib import suppress
from pathlib import Path

from ..process.run_request import RunRequest, sights_of_run
from ..sandbox.visible_files import is_wide, system_sights

_MISSED = re.compile(
    r"""(/[^\s:'"‘’]+)['"’]?:[ ](?:bad[ ]interpreter:[ ])?
        (?:No[ ]such[ ]file[ ]or[ ]directory|not[ ]found|Permission[ ]denied)
    |(?:No[ ]such[ ]file[ ]or[ ]directory:[ ]'|program[ ]not[ ]found:[ ]|first[ ]line[ ]names,[ ])(/[^\s:'"]+)""",
    re.VERBOSE,
)
"""Paths that shells, Python and this package say are not there, or, confined by Landlock, may not be read."""
_SHELL_FILES = (".sh", ".bash", ".zsh")


def unseen_programs(request: RunRequest, reason: str) -> str:
    """Returns the end of a sentence on programs that a failure misses although this machine has them; mostly empty.

    Only programs and shell files are looked for: a job could find out by this which other files there are.

    Args:
        request: Request of the run, with its box.
        reason: Reason why the run failed, with the last lines of its log.
    """
    if request.box.level == "none":
        return ""
    missed = dict.fromkeys(Path(found[1] or found[2]) for found in _MISSED.finditer(reason))
    there = [path for path in missed if _is_program(path)]
    if not there:
        return ""
    sights = [*system_sights(), *sights_of_run(request)]
    for path in there:
        real = Path(os.path.realpath(path))
        # What is hidden stays so, also where the setting names it.
        unseen = [each for each in (path, real) if not any(each.is_relative_to(sight.path) for sight in sights)]
        if unseen:
            folders = ":".join(dict.fromkeys(str(_folder_of(each)) for each in unseen))
            return (
                f"; {path} is on this machine, but jobs do not see it: set ROBOMAKER_SANDBOX_SHOW={folders} where they "
                "are carried out"
            )
    return ""


def _is_program(path: Path) -> bool:
    with suppress(OSError):  # in a folder that this user may not look into
        return path.is_file() and (os.access(path, os.X_OK) or path.suffix in _SHELL_FILES)
    return False


def _folder_of(program: Path) -> Path:
    """Returns the folder that has to be shown for a program: that of its installation, or itself in a wide folder."""
    folder = program.parent.parent if program.parent.name in ("bin", "sbin") else program.parent
    return program if is_wide(folder) else folder
