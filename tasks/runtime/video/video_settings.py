"""Video settings of a run, from the variables of its launch configurations."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.variables import variables_of
from ....schemas.wire.errors import LaunchError

CAMERA_VARIABLE = "ROBOMAKER_VIDEO_CAMERA"
SIZE_VARIABLE = "ROBOMAKER_VIDEO_SIZE"
RATE_VARIABLE = "ROBOMAKER_VIDEO_FPS"
DEFAULT_SIZE = (640, 480)
DEFAULT_RATE_HZ = 15
_SMALLEST, _LARGEST = 64, 2048
_MAX_RATE_HZ = 60
_INVALID = "InvalidInput"


@dataclass(frozen=True)
class VideoSettings:
    """Camera, size and rate of a video."""

    camera: str | None = None
    """`follow`, `top`, `both` or the name of a camera of the model; None: what the environment or the model say."""

    size: tuple[int, int] | None = None
    """Width and height in pixels; None: 640 x 480, or half of it without OpenGL."""

    rate_hz: int = DEFAULT_RATE_HZ
    """Pictures per simulated second."""


DEFAULTS = VideoSettings()


def video_settings(variables: Mapping[str, str]) -> VideoSettings:
    """Reads `ROBOMAKER_VIDEO_CAMERA`, `ROBOMAKER_VIDEO_SIZE` and `ROBOMAKER_VIDEO_FPS`.

    Raises:
        LaunchError: One of them is no camera, size or rate.
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
    """The settings of a run; what the simulation application's variables say goes first.

    Raises:
        LaunchError: See `video_settings`.
    """
    return video_settings(variables_of(plan))


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
    return LaunchError(f"{variable} is {value!r}; it has to be {right}", _INVALID)
