"""Video settings of a run, from the variables of its launch configurations."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.variables import variables_of
from ....schemas.wire.errors import LaunchError
from ....schemas.worlds.appearance import appearance_named

LIVE_VIEW_FILE = "live-view.json"
"""File in the work folder: `{"url": …}`, while the live view runs. It appears whole, for those who wait for it."""

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
    """Camera, size and rate of a video."""

    camera: str | None = None
    """`follow`, `top`, `both` or the name of a camera of the model; None: what the environment or the model say."""

    size: tuple[int, int] | None = None
    """Width and height in pixels; None: 640 x 480, or half of it without OpenGL."""

    rate_hz: int = DEFAULT_RATE_HZ
    """Pictures per simulated second."""

    appearance: str | None = None
    """How a world is lit for cameras, `random` included; None: as its model says."""

    seed: int = 0
    """Seed of the appearance that `random` chooses."""


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
        LaunchError: See `video_settings` and `appearance_of`.
    """
    return replace(video_settings(variables_of(plan)), appearance=appearance_of(plan), seed=plan.seed)


def appearance_of(plan: RunPlan) -> str | None:
    """The name of the appearance that a run's variables ask for; None: they ask for none.

    Raises:
        LaunchError: There is no such appearance.
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
