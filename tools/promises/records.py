"""The record of the promised surfaces: files of facts, and how they are compared and written."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from .facts import Facts, additions, breaks, read, written
from .surfaces import SURFACES

FOLDER = Path(__file__).parents[2] / "tests" / "promises" / "recorded"
HINT = "run `python -m tools.promises --record` and commit what it writes"


@cache
def facts_now(surface: str) -> Facts:
    """Returns the facts of a surface as the program has them now."""
    return SURFACES[surface]()


def path_of(surface: str, folder: Path = FOLDER) -> Path:
    """Returns the path of a surface's record."""
    return folder / f"{surface}.json"


def recorded(surface: str, folder: Path = FOLDER) -> Facts:
    """Reads the record of a surface; one that was never recorded promises nothing."""
    path = path_of(surface, folder)
    return read(path.read_text()) if path.is_file() else {}


def broken_promises(folder: Path = FOLDER) -> Iterator[str]:
    """Yields a sentence for each promise that the program does not keep, with the member and what would be right."""
    for surface in SURFACES:
        for problem in breaks(recorded(surface, folder), facts_now(surface)):
            yield f"{surface}: {problem}"


def unrecorded(folder: Path = FOLDER) -> Iterator[str]:
    """Yields the members that the record lacks, or has otherwise."""
    for surface in SURFACES:
        for name in additions(recorded(surface, folder), facts_now(surface)):
            yield f"{surface}: {name}"


def record(folder: Path = FOLDER) -> None:
    """Writes the facts of all surfaces; the same program gives the same files."""
    folder.mkdir(parents=True, exist_ok=True)
    for surface in SURFACES:
        path_of(surface, folder).write_text(written(facts_now(surface)))
