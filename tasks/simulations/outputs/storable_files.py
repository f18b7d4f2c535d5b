"""Selection of a run's output files for upload: size and number limits, and unique names."""

import heapq
import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import JsonValue

from ....schemas.runs.provenance import PROVENANCE_FILE, ManifestFile
from ....schemas.runs.trial_rows import TRIALS_FILE
from ....schemas.settings import Settings
from ....schemas.wire.common import shorten
from ....schemas.wire.errors import StorageError, TransferStoppedError
from ...files.untrusted_folders import FolderFile, files_told, os_failures
from ...storage import MANIFEST_NAME
from ...storage.object_store import Stopped, check_key, join_key, never

RESULT_FILE = "result.json"
_MOST_NAMED = 1000
"""Maximum number of left-out files that a manifest names, to keep it small."""

FIRST = (RESULT_FILE, TRIALS_FILE, PROVENANCE_FILE, "logs/stdout.log", "logs/stderr.log")
"""Files that are uploaded first, because they say how the run went."""

_LONGEST_NAME = 300


def rank(name: str) -> tuple[int, int, bytes]:
    """Returns the sort key of an output file: the most important ones are uploaded first, as space is limited."""
    first = FIRST.index(name) if name in FIRST else len(FIRST)
    return first, name.count("/"), os.fsencode(name)


def check_wanted(ended: Stopped) -> None:
    """Raises an error if a run's outputs are no longer wanted, while they are listed.

    Raises:
        TransferStoppedError: `ended` returned true.
    """
    if ended():
        raise TransferStoppedError("the outputs are not wanted any more")


def lacks_outputs(about: Mapping[str, JsonValue]) -> bool:
    """Returns whether a manifest says that outputs are missing because of limits or a cancellation."""
    left_out = about.get("leftOut")
    return bool(about.get("partial")) or (isinstance(left_out, dict) and bool(left_out.get("beyondLimits")))


class LeftOut:
    """Output files of a run that are not uploaded, with the reasons; of very many, only the first are named."""

    def __init__(self) -> None:
        self.files = 0
        self.size_bytes = 0
        self.beyond_limits = 0
        """Number of files left out because of limits of size and number."""
        self._named: list[dict[str, JsonValue]] = []

    @property
    def lines(self) -> list[str]:
        """Lines about output files that were left out of the upload: `'big.bin' is not stored: it ...`."""
        return [f"'{each['path']}' is not stored: it {each['why']}" for each in self._named]

    def note(self, name: str, why: str, size_bytes: int = 0) -> None:
        """Records an output file that is not uploaded, with the reason.

        Args:
            name: Path of the file among the outputs.
            why: Reason, as a predicate.
            size_bytes: Size of the file in bytes.
        """
        self.count(1, size_bytes)
        if len(self._named) < _MOST_NAMED:
            path = shorten(ascii(name)[1:-1], _LONGEST_NAME)
            self._named.append({"path": path, "sizeBytes": size_bytes, "why": why})

    def count(self, files: int, size_bytes: int) -> None:
        """Adds files that are not uploaded to the counts of files and bytes, without their names."""
        self.files += files
        self.size_bytes += size_bytes

    def about(self) -> dict[str, Any]:
        """Makes the summary of files left out for the manifest; empty if there are none."""
        if not self.files:
            return {}
        counts = {"files": self.files, "sizeBytes": self.size_bytes, "beyondLimits": self.beyond_limits}
        return {"leftOut": {**counts, "named": list(self._named)}}


@dataclass
class Room:
    """Space that is left for a run's outputs in the object store, in bytes and files, and the files without space."""

    most_bytes: int
    most_files: int
    left_out: LeftOut = field(default_factory=LeftOut)
    used_bytes: int = 0
    used_files: int = 0

    @classmethod
    def of(cls, settings: Settings) -> "Room":
        """Returns the space that the settings allow for one run's outputs."""
        return cls(settings.max_output_gb * 10**9, settings.max_output_files)

    def use(self, files: list[ManifestFile]) -> None:
        """Subtracts files that are uploaded already from the space."""
        self.used_files += len(files)
        self.used_bytes += sum(file.size_bytes for file in files)

    def why_not(self, size_bytes: int) -> str | None:
        """Returns the reason why a file of so many bytes has no space left among a run's outputs; `None` if it has."""
        if self.used_files >= self.most_files:
            return f"is beyond the {self.most_files} files that are stored of a run (ROBOMAKER_MAX_OUTPUT_FILES)"
        if self.used_bytes + size_bytes > self.most_bytes:
            most = f"{self.most_bytes / 1e9:.3g} GB"
            return f"is beyond the {most} that are stored of a run (ROBOMAKER_MAX_OUTPUT_GB)"
        return None

    def take(self, name: str, size_bytes: int) -> bool:
        """Reserves space for a file, or records that it is left out; returns whether there is space."""
        if (why := self.why_not(size_bytes)) is not None:
            self.left_out.note(name, why, size_bytes)
            self.left_out.beyond_limits += 1
            return False
        self.used_files += 1
        self.used_bytes += size_bytes
        return True

    def notes(self) -> list[str]:
        """Returns the note about outputs that were left out for lack of space; empty if none were."""
        if not (count := self.left_out.beyond_limits):
            return []
        files = "1 output is" if count == 1 else f"{count} outputs are"
        return [
            f"{files} not stored: a run may leave {self.most_files} files of {self.most_bytes / 1e9:.3g} GB "
            "(ROBOMAKER_MAX_OUTPUT_FILES, ROBOMAKER_MAX_OUTPUT_GB); manifest.json names what is left out"
        ]


def storable_files(folder: Path, prefix: str, room: Room, ended: Stopped = never) -> list[FolderFile]:
    """Lists a finished run's output files that can be uploaded; records the others.

    Left out are links, pipes, sockets and devices, unreadable files, names that no object store accepts, a
    `manifest.json` of the application, and files without space. Only as many files as there is space for are kept in
    memory.

    Args:
        folder: Folder of the run's outputs.
        prefix: Prefix of the files' keys.
        room: Space for stored files; listed files are subtracted from it, left-out files are recorded in it.
        ended: Function called before each file, so it has to be fast; true stops the listing.

    Raises:
        TransferStoppedError: `ended` said so.
        StorageError: The folder of the outputs does not exist.
    """
    count = size_bytes = 0

    def leave_out(path: Path, why: str) -> None:
        room.left_out.note(os.fspath(path.relative_to(folder)), why)

    def found() -> Iterator[tuple[FolderFile, int]]:
        nonlocal count, size_bytes
        for file in files_told(folder, leave_out):
            check_wanted(ended)
            if (why := _obstacle(file, prefix)) is not None:
                leave_out(file.path, why)
                continue
            size = file.path.lstat().st_size
            count, size_bytes = count + 1, size_bytes + size
            yield file, size

    with os_failures(f"read the folder {folder}"):
        most = max(0, room.most_files - room.used_files) + 1
        best = heapq.nsmallest(most, found(), key=lambda each: rank(each[0].name))
    files = [file for file, size in best if room.take(file.name, size)]
    more = count - len(best)  # than there is room for; one of them has been named
    room.left_out.count(more, size_bytes - sum(size for _, size in best))
    room.left_out.beyond_limits += more
    return sorted(files, key=lambda file: os.fsencode(file.name))


def _obstacle(file: FolderFile, prefix: str) -> str | None:
    if file.name == MANIFEST_NAME:
        return "has the name of the manifest"
    try:
        check_key(join_key(prefix, file.name))
    except StorageError as error:
        return f"has a name that no store takes: {error}"
    return None if os.access(file.path, os.R_OK) else "may not be read"


@dataclass(frozen=True)
class Found:
    """An output file that is to be uploaded."""

    name: str
    """Preferred name: `<configuration>/<path below the glob's fixed folder>`."""

    path: Path
    replaces: bool = False
    """Whether the file is a later version of one that its configuration has uploaded under the same name."""


def distinct(
    outputs: Collection[str], rolled: Collection[str], files: Iterable[Found]
) -> tuple[list[FolderFile], list[str]]:
    """Gives output files unique names that any object store accepts.

    Args:
        outputs: Names of the run's own outputs.
        rolled: Names of the files uploaded during the run.
        files: Other files, in order of precedence.

    Returns:
        The files with their names, and a line for each that did not get its preferred name.
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
    """Set of used names, and of the folders that they contain."""

    def __init__(self, names: Iterable[str]) -> None:
        self._files: set[str] = set()
        self._folders: set[str] = set()
        for name in names:
            self._add(name)

    def take(self, name: str) -> str:
        """Reserves the name, or else the first free variant: `maps/a.pgm.1`; `maps.1/a.pgm` if `maps` is a file.

        Returns the name that is reserved.
        """
        free = next(each for each in _like(name) if self._is_free(each))
        self._add(free)
        return free

    def _add(self, name: str) -> None:
        self._files.add(name)
        self._folders.update(_parent_folders(name))

    def _is_free(self, name: str) -> bool:
        return name not in self._files and name not in self._folders and self._files.isdisjoint(_parent_folders(name))


def _like(name: str) -> Iterator[str]:
    yield name
    folder, _, rest = name.partition("/")
    number = 0
    while True:
        number += 1
        yield f"{name}.{number}"
        yield f"{folder}.{number}/{rest}"


def _parent_folders(name: str) -> list[str]:
    """Lists the parent folders in a file's name."""
    return [str(parent) for parent in PurePosixPath(name).parents if parent.name]
