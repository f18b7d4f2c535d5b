"""Names of the files that films are made of and become, for those who know nothing of MuJoCo."""

from pathlib import Path

from pydantic import Field

from ....schemas.wire.base import Model

VIDEO_FILE = "video.mp4"
POSTER_FILE = "poster.png"
CLIP_FILE = "last-10s.mp4"
STATE_LOG_FOLDER = "state-log"
"""In the work folder of a run; see `state_log`."""
NO_PHYSICS = "the environment has no `physics` to film"


class VideoRequest(Model):
    """What films to make of a log of states."""

    log_dir: Path = Field(description="The log.")
    output_dir: Path = Field(description="Where the films are written.")
    backend: str = Field(description="`egl`, `osmesa` or `rays`.")
    camera: str | None = Field(description="See `VideoSettings`.")
    size: tuple[int, int] | None = Field(description="See `VideoSettings`.")
    rate_hz: int = Field(description="See `VideoSettings`.")
    whole_video: bool = Field(description="Whether `video.mp4` is made too.")
    parent_pid: int = Field(description="The process with which the one that films ends.")


def unfinished(path: Path) -> Path:
    """Returns where a file is while it is being written."""
    return path.with_name(f".{path.name}.unfinished")
