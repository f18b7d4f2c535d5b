"""Settings of videos and of the recorded camera, and names of video files; imports no MuJoCo."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from pydantic import Field

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.variables import number_in, variables_of
from ....schemas.wire.base import Model
from ....schemas.wire.errors import LaunchError
from ....schemas.worlds.appearance import appearance_named

LIVE_VIEW_FILE = "live-view.json"
"""Name of a file in the work folder with the live view's URL as JSON (`{"url": …}`), while it runs. It is written
atomically, as other processes wait for it.
"""

CAMERA_VARIABLE = "ROBOMAKER_VIDEO_CAMERA"
SIZE_VARIABLE = "ROBOMAKER_VIDEO_SIZE"
RATE_VARIABLE = "ROBOMAKER_VIDEO_FPS"
APPEARANCE_VARIABLE = "ROBOMAKER_APPEARANCE"
DEFAULT_SIZE = (640, 480)
DEFAULT_RATE_HZ = 15
_SMALLEST, _LARGEST = 64, 2048
_MAX_RATE_HZ = 60


@dataclass(frozen=True)
class VideoSettings:
    """Camera, size and frame rate of a video."""

    camera: str | None = None
    """Camera view: `follow`, `top`, `both` or the name of a camera of the model; None: that of the environment or the
    model.
    """

    size: tuple[int, int] | None = None
    """Width and height in pixels; None: 640 x 480, or half of it without OpenGL."""

    rate_hz: int = DEFAULT_RATE_HZ
    """Frames per simulated second."""

    appearance: str | None = None
    """Name of the world's lighting for cameras, or `random`; None: that of the model."""

    seed: int = 0
    """Random seed of the appearance `random`."""


DEFAULTS = VideoSettings()


def video_settings(variables: Mapping[str, str]) -> VideoSettings:
    """Reads the video settings from `ROBOMAKER_VIDEO_CAMERA`, `ROBOMAKER_VIDEO_SIZE` and `ROBOMAKER_VIDEO_FPS`.

    Raises:
        LaunchError: A variable is not a valid camera, size or rate.
    """
    camera = variables.get(CAMERA_VARIABLE)
    if camera is not None and not camera.strip():
        raise _wrong(CAMERA_VARIABLE, camera, "follow, top, both, or the name of one of the model's cameras")
    size, rate = variables.get(SIZE_VARIABLE), variables.get(RATE_VARIABLE)
    return VideoSettings(
        camera=camera,
        size=_size(size) if size is not None else None,
        rate_hz=_rate_hz(rate) if rate is not None else DEFAULT_RATE_HZ,
    )


def settings_of(plan: RunPlan) -> VideoSettings:
    """Returns the video settings of a run; the simulation application's variables win.

    Raises:
        LaunchError: A variable is not a valid camera, size, rate or name of an appearance.
    """
    return replace(video_settings(variables_of(plan)), appearance=appearance_of(plan), seed=plan.seed)


def appearance_of(plan: RunPlan) -> str | None:
    """Returns the name of the lighting that a run's variables ask for; `None` if they ask for none.

    Raises:
        LaunchError: No appearance has this name.
    """
    name = variables_of(plan).get(APPEARANCE_VARIABLE)
    if name is None:
        return None
    try:
        appearance_named(name)
    except ValueError as cause:
        raise LaunchError(f"{APPEARANCE_VARIABLE}: {cause}") from cause
    return name


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([0-9]{1,5})x([0-9]{1,5})", text)
    width, height = (int(number) for number in match.groups()) if match else (0, 0)
    if not all(_SMALLEST <= number <= _LARGEST and number % 2 == 0 for number in (width, height)):
        raise _wrong(
            SIZE_VARIABLE,
            text,
            f"width x height in pixels, such as 320x240, both even and from {_SMALLEST} to {_LARGEST}",
        )
    return width, height


def _rate_hz(text: str) -> int:
    if not re.fullmatch("[0-9]{1,3}", text) or not 1 <= int(text) <= _MAX_RATE_HZ:
        raise _wrong(RATE_VARIABLE, text, f"a whole number of pictures per simulated second, 1 to {_MAX_RATE_HZ}")
    return int(text)


def _wrong(variable: str, value: str, right: str) -> LaunchError:
    return LaunchError(f"{variable} is {value!r}; it has to be {right}")


RECORDED_RATE_VARIABLE = "ROBOMAKER_RECORD_CAMERA_HZ"
RECORDED_CAMERA_VARIABLE = "ROBOMAKER_RECORD_CAMERA"
_MAX_RECORDED_RATE_HZ = 60.0
_BOTH = "both"


class CameraRecording(NamedTuple):
    """Settings of the camera that is recorded or published to ROS nodes: its rate and name."""

    rate_hz: float | None
    """Images per simulated second; None: the rate in the options of the ROS bridge."""

    camera: str | None = None
    """Camera view: `follow`, `top` or the name of a camera of the model; None: the robot's `front`, else the first one.
    """

    appearance: str | None = None
    """Name of the world's lighting; see `VideoSettings`."""

    seed: int = 0
    """Random seed of the appearance `random`."""

    is_recorded: bool = True
    """Whether images are recorded; else they are only published to ROS nodes."""


def camera_recording(plan: RunPlan) -> CameraRecording | None:
    """Returns the camera recording that variables ask for; None: no images, the default of runs without ROS nodes.

    Raises:
        LaunchError: The rate is not a number above 0 and at most 60, two views are asked for in one picture,
            or there is no such appearance.
    """
    variables = variables_of(plan)
    text = variables.get(RECORDED_RATE_VARIABLE)
    is_recorded = plan.record and text is not None
    if not is_recorded and plan.ros is None:
        return None
    rate_hz = number_in(text) if text is not None else None
    if rate_hz is not None and not 0 < rate_hz <= _MAX_RECORDED_RATE_HZ:
        raise LaunchError(
            f"{RECORDED_RATE_VARIABLE} is {text!r}; it has to be pictures per simulated second, above 0 and at most "
            f"{_MAX_RECORDED_RATE_HZ:g}, such as 5"
        )
    camera = variables.get(RECORDED_CAMERA_VARIABLE) or None
    if camera == _BOTH:
        raise LaunchError(
            f"{RECORDED_CAMERA_VARIABLE} is {camera!r}, but a picture of two views has no camera_info true of it; "
            "it has to be follow, top, or the name of one of the model's cameras (videos may have both)"
        )
    return CameraRecording(rate_hz, camera, appearance_of(plan), plan.seed, is_recorded)


VIDEO_FILE = "video.mp4"
POSTER_FILE = "poster.png"
CLIP_FILE = "last-10s.mp4"
STATE_LOG_FOLDER = "state-log"
"""Name of the state log's folder in the work folder of a run; see `state_log`."""
NO_PHYSICS = "the environment has no `physics` to record"


class VideoRequest(Model):
    """Request to render videos from a state log."""

    log_dir: Path = Field(description="The log.")
    output_dir: Path = Field(description="Folder that the videos are written to.")
    backend: str = Field(description="`egl`, `osmesa` or `rays`.")
    settings: VideoSettings = Field(description="Camera, size and rate.")
    whole_video: bool = Field(description="Whether `video.mp4` is made too.")
    parent_pid: int = Field(description="The rendering process ends with this process.")
