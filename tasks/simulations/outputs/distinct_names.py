"""Names of uploaded files among all outputs of a run: what differs gets names that differ, and nothing is written over.

The run's own outputs keep their names, then files that were uploaded while it went on, then the files of one upload
configuration after the other.
"""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ...storage.folders import FolderFile


@dataclass(frozen=True)
class Found:
    """A file that is to be uploaded."""

    name: str
    """The name it would have alone: `<configuration>/<path below the glob's fixed folder>`."""

    path: Path
    replaces: bool = False
    """Whether it is a later version of what its own configuration may have uploaded under that name."""


def distinct(
    outputs: Collection[str], rolled: Collection[str], files: Iterable[Found]
) -> tuple[list[FolderFile], list[str]]:
    """Gives files names that no other file has, and that no store takes for a folder of other files.

    Args:
        outputs: names of the run's own outputs.
        rolled: names of what was stored while the run went on.
        files: the other files, first come, first served.

    Returns:
        The files under the names they get, and a line for each that does not get the name it would have alone.
    """
    names = _Names([*outputs, *rolled])
    # What has versions, each of which replaces the one before, and the name that it got.
    versions = {name: name for name in rolled if name not in outputs}
    placed: dict[str, FolderFile] = {}
    notes: list[str] = []
    for file in files:
        name = versions.get(file.name) if file.replaces else None
        if name is None:
            name = names.take(file.name)
            if name != file.name:
                notes.append(f"{file.name} is stored as {name}, since another file has its name")
        if file.replaces:
            versions[file.name] = name
        placed[name] = FolderFile(name, file.path)
    return list(placed.values()), notes


class _Names:
    """Names that are taken, with the folders they are in."""

    def __init__(self, names: Iterable[str]) -> None:
        self._files: set[str] = set()
        self._folders: set[str] = set()
        for name in names:
            self._add(name)

    def take(self, name: str) -> str:
        """The name itself, or the first free one like it: `maps/a.pgm.1`; `maps.1/a.pgm` where `maps` is a file."""
        free = next(each for each in _like(name) if self._is_free(each))
        self._add(free)
        return free

    def _add(self, name: str) -> None:
        self._files.add(name)
        self._folders.update(_above(name))

    def _is_free(self, name: str) -> bool:
        return name not in self._files and name not in self._folders and self._files.isdisjoint(_above(name))


def _like(name: str) -> Iterator[str]:
    yield name
    folder, _, rest = name.partition("/")
    number = 0
    while True:
        number += 1
        yield f"{name}.{number}"
        yield f"{folder}.{number}/{rest}"


def _above(name: str) -> list[str]:
    """The folders that a file of that name is in."""
    return [str(parent) for parent in PurePosixPath(name).parents if parent.name]
