"""Names of video files and of the state log, for modules that do not import MuJoCo."""

from pathlib import Path

from pydantic import Field

from ....schemas.wire.base import Model
from .video_settings import VideoSettings

VIDEO_FILE = "video.mp4"
POSTER_FILE = "poster.png"
CLIP_FILE = "last-10s.mp4"
STATE_LOG_FOLDER = "state-log"
"""Name of the state log's folder in the work folder of a run; see `state_log`."""
NO_PHYSICS = "the environment has no `physics` to record"


class VideoRequest(Model):
    """The videos to make of a log of states."""

    log_dir: Path = Field(description="The log.")
    output_dir: Path = Field(description="Folder that the videos are written to.")
    backend: str = Field(description="`egl`, `osmesa` or `rays`.")
    settings: VideoSettings = Field(description="Camera, size and rate.")
    whole_video: bool = Field(description="Whether `video.mp4` is made too.")
    parent_pid: int = Field(description="The rendering process ends with this process.")


def unfinished(path: Path) -> Path:
    """Returns where a file is while it is being written."""
    return path.with_name(f".{path.name}.unfinished")
