"""The Git commit that a specification was run from."""

import logging
import subprocess
from pathlib import Path

from ...schemas.reports.inputs import SourceCommit

_LIMIT_S = 10.0
# A repository's own settings name programs that Git would start, and nothing is to be written into it.
_GIT = ("git", "-c", "core.fsmonitor=false", "--no-optional-locks")
_logger = logging.getLogger(__name__)


def commit_of(path: Path) -> SourceCommit | None:
    """The commit that the folder of a file is at.

    Args:
        path: the file, or a folder.

    Returns:
        The commit, and whether tracked files differ from it; None where there is no repository, no commit in it yet,
        or no `git` on this machine.
    """
    folder = path.absolute() if path.is_dir() else path.absolute().parent
    if not any((parent / ".git").exists() for parent in (folder, *folder.parents)):
        return None
    try:
        commit = _ask(folder, "rev-parse", "HEAD").strip()
        changed = bool(_ask(folder, "status", "--porcelain", "--untracked-files=no").strip())
    except (OSError, subprocess.SubprocessError) as problem:
        _logger.info("the commit of %s is not known: %s", folder, problem)
        return None
    return SourceCommit(commit=commit, changed=changed)


def _ask(folder: Path, *words: str) -> str:
    ended = subprocess.run(
        [*_GIT, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=_LIMIT_S,
        stdin=subprocess.DEVNULL,
    )
    return ended.stdout
