"""Timeline of a run: margins and lengths of logs by simulated time, and the times that videos show (`timeline.json`).

Pages that follow a run along its simulated time read it. It has no poses: the recording has those.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import Field, FiniteFloat, ValidationError

from ....schemas.wire.base import Model, optional
from ...files.untrusted_files import read_left, write_anew

TIMELINE_FILE = "timeline.json"
MAX_TIMELINE_BYTES = 4 * 1024 * 1024
"""Size limit of `timeline.json` in bytes, several times that of the longest one; a longer file is not read."""
MOST_SAMPLES = 400
"""Limit of the samples of one series: a drawing of it has some 700 pixels."""


class MarginSeries(Model):
    """Margin of a requirement along a run: at each time the margin that it would have if the run ended then."""

    requirement: str = Field(description="Name of the requirement.")
    unit: str | None = optional("Unit of the margin.")
    samples: list[tuple[FiniteFloat, FiniteFloat]] = Field(
        default=[], description="(simulated time in s, margin), which holds until the next one; at most 400."
    )


class LogSeries(Model):
    """Length of a log along a run, which says when each of its lines was there."""

    name: str = Field(description="Path of the log in the outputs, `logs/stdout.log`.")
    samples: list[tuple[FiniteFloat, int]] = Field(
        default=[], description="(simulated time in s, bytes in the file then), where it has grown; at most 400."
    )


class FilmTimes(Model):
    """Simulated time that a video shows: it runs as fast as that, so the frame at `t` shows `begins_s + t`."""

    begins_s: float = Field(ge=0, allow_inf_nan=False, description="Simulated time of the first frame, in seconds.")
    rate_hz: float = Field(
        gt=0, allow_inf_nan=False, description="Frames per simulated second, and per second of the video."
    )
    frames: int = Field(ge=0, description="Number of frames.")

    @property
    def ends_s(self) -> float:
        """Simulated time in seconds at which the last frame ends."""
        return self.begins_s + self.frames / self.rate_hz


class RunTimeline(Model):
    """Content of a run's `timeline.json`."""

    schema_version: Literal[1] = Field(default=1, description="Format version of this document.")
    margins: list[MarginSeries] = Field(default=[], description="Margins of requirements, in their order.")
    logs: list[LogSeries] = Field(default=[], description="Lengths of the logs.")
    videos: dict[str, FilmTimes] = Field(default={}, description="Times that videos show, by file name.")


def read_timeline(data: bytes) -> RunTimeline:
    """Reads a timeline; an empty one where the content is none, since a program of the run may have written it."""
    try:
        return RunTimeline.model_validate_json(data)
    except ValidationError:
        return RunTimeline()


def write_timeline(timeline: RunTimeline, output_dir: Path) -> None:
    """Writes `timeline.json`, atomically.

    Raises:
        OSError: The folder cannot be written.
    """
    write_anew(output_dir / TIMELINE_FILE, timeline.model_dump_json(exclude_none=True).encode() + b"\n")


def add_videos(videos: Mapping[str, FilmTimes], output_dir: Path) -> None:
    """Adds the times of videos that were made after a run to its timeline.

    Args:
        videos: Times that the videos show, by file name.
        output_dir: Folder of the run's outputs.

    Raises:
        OSError: The folder cannot be written.
    """
    try:
        known = read_timeline(read_left(output_dir / TIMELINE_FILE, MAX_TIMELINE_BYTES))
    except OSError:  # the run was killed before it wrote one
        known = RunTimeline()
    write_timeline(known.model_copy(update={"videos": {**known.videos, **videos}}), output_dir)
