"""Bounds of what a run's outputs may be: how much is stored of them, how many files, and what is left out.

A job's code may leave anything: a file of 256 GB without a block on the disk, or hundreds of thousands of empty ones.
Sizes count as they are stored, holes as well, since no S3 server has holes.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import JsonValue

from ....schemas.runs.manifest import ManifestFile
from ....schemas.runs.provenance import PROVENANCE_FILE
from ....schemas.runs.trial_rows import TRIALS_FILE
from ....schemas.settings import Settings
from ....schemas.wire.common import shorten
from ....schemas.wire.errors import TransferStoppedError
from ...storage.base import Stopped

RESULT_FILE = "result.json"
_MOST_NAMED = 1000
"""Files that a manifest names as left out: who left a million out needs no million names, and readers fetch them."""

FIRST = (RESULT_FILE, TRIALS_FILE, PROVENANCE_FILE, "logs/stdout.log", "logs/stderr.log")
"""Files that are stored first, because they say how the run went."""

_LONGEST_NAME = 300


def rank(name: str) -> tuple[int, int, bytes]:
    """The order in which outputs are stored as long as there is room: what says how the run went, then the top."""
    first = FIRST.index(name) if name in FIRST else len(FIRST)
    return first, name.count("/"), os.fsencode(name)


def check_wanted(ended: Stopped) -> None:
    """Ends the listing of a run's outputs when they are not wanted any more: there may be very many.

    Raises:
        TransferStoppedError: `ended` said so.
    """
    if ended():
        raise TransferStoppedError("the outputs are not wanted any more")


def lacks_outputs(about: Mapping[str, JsonValue]) -> bool:
    """Whether a manifest says that outputs are missing which other limits, or no cancellation, would have kept."""
    left_out = about.get("leftOut")
    return bool(about.get("partial")) or (isinstance(left_out, dict) and bool(left_out.get("beyondLimits")))


class LeftOut:
    """Files of a run that are not stored, and why."""

    def __init__(self) -> None:
        self.files = 0
        self.size_bytes = 0
        self.beyond_limits = 0
        """How many of them were left out for the limits of size and number."""
        self._named: list[dict[str, JsonValue]] = []

    @property
    def lines(self) -> list[str]:
        """A line for each that is named."""
        return [f"'{each['path']}' is not stored: it {each['why']}" for each in self._named]

    def note(self, name: str, why: str, size_bytes: int = 0) -> None:
        """Notes a file that is left out.

        Args:
            name: its path among the outputs.
            why: what is wrong with it, as a predicate.
            size_bytes: its size.
        """
        self.count(1, size_bytes)
        if len(self._named) < _MOST_NAMED:
            path = shorten(ascii(name)[1:-1], _LONGEST_NAME)
            self._named.append({"path": path, "sizeBytes": size_bytes, "why": why})

    def count(self, files: int, size_bytes: int) -> None:
        """Counts files that are left out without their names."""
        self.files += files
        self.size_bytes += size_bytes

    def about(self) -> dict[str, Any]:
        """Summary for the manifest; empty if no file was left out."""
        if not self.files:
            return {}
        counts = {"files": self.files, "sizeBytes": self.size_bytes, "beyondLimits": self.beyond_limits}
        return {"leftOut": {**counts, "named": list(self._named)}}


@dataclass
class Room:
    """Space for a run's outputs in the store: bytes and files that it may still have."""

    most_bytes: int
    most_files: int
    left_out: LeftOut = field(default_factory=LeftOut)
    used_bytes: int = 0
    used_files: int = 0

    @classmethod
    def of(cls, settings: Settings) -> "Room":
        """The room that settings give one run."""
        return cls(settings.max_output_gb * 10**9, settings.max_output_files)

    def use(self, files: list[ManifestFile]) -> None:
        """Counts what is stored already."""
        self.used_files += len(files)
        self.used_bytes += sum(file.size_bytes for file in files)

    def why_not(self, size_bytes: int) -> str | None:
        """Why a file of some size has no room, as a predicate; `None`: it has."""
        if self.used_files >= self.most_files:
            return f"is beyond the {self.most_files} files that are stored of a run (ROBOMAKER_MAX_OUTPUT_FILES)"
        if self.used_bytes + size_bytes > self.most_bytes:
            most = f"{self.most_bytes / 1e9:.3g} GB"
            return f"is beyond the {most} that are stored of a run (ROBOMAKER_MAX_OUTPUT_GB)"
        return None

    def take(self, name: str, size_bytes: int) -> bool:
        """Gives a file room, or notes that it is left out; returns whether it has room."""
        if (why := self.why_not(size_bytes)) is not None:
            self.left_out.note(name, why, size_bytes)
            self.left_out.beyond_limits += 1
            return False
        self.used_files += 1
        self.used_bytes += size_bytes
        return True

    def notes(self) -> list[str]:
        """The line beside the verdict about what had no room."""
        if not (count := self.left_out.beyond_limits):
            return []
        files = "1 output is" if count == 1 else f"{count} outputs are"
        return [
            f"{files} not stored: a run may leave {self.most_files} files of {self.most_bytes / 1e9:.3g} GB "
            "(ROBOMAKER_MAX_OUTPUT_FILES, ROBOMAKER_MAX_OUTPUT_GB); manifest.json names what is left out"
        ]
