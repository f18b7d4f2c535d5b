"""Settings of the recorded camera, from the variables of a run's launch configurations."""

from typing import NamedTuple

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.variables import number_in, variables_of
from ....schemas.wire.errors import LaunchError
from .video_settings import appearance_of

RATE_VARIABLE = "ROBOMAKER_RECORD_CAMERA_HZ"
CAMERA_VARIABLE = "ROBOMAKER_RECORD_CAMERA"
_MAX_RATE_HZ = 60.0
_BOTH = "both"


class CameraRecording(NamedTuple):
    """Settings of the recorded camera: its frame rate, and which one it is."""

    rate_hz: float
    """Pictures per simulated second."""

    camera: str | None = None
    """`follow`, `top` or the name of a camera of the model; None: the robot's `front`, else the first one."""

    appearance: str | None = None
    """How a world is lit; see `VideoSettings`."""

    seed: int = 0
    """Seed of the appearance that `random` chooses."""


def camera_recording(plan: RunPlan) -> CameraRecording | None:
    """Returns what a run's variables ask for; None: no pictures, which is the default.

    Raises:
        LaunchError: The rate is not a number above 0 and at most 60, two views are asked for in one picture,
            or there is no such appearance.
    """
    variables = variables_of(plan)
    if not plan.record or (text := variables.get(RATE_VARIABLE)) is None:
        return None
    rate_hz = number_in(text)
    if not 0 < rate_hz <= _MAX_RATE_HZ:
        raise LaunchError(
            f"{RATE_VARIABLE} is {text!r}; it has to be pictures per simulated second, above 0 and at most "
            f"{_MAX_RATE_HZ:g}, such as 5"
        )
    camera = variables.get(CAMERA_VARIABLE) or None
    if camera == _BOTH:
        raise LaunchError(
            f"{CAMERA_VARIABLE} is {camera!r}, but a picture of two views has no camera_info that is true of it; it "
            "has to be follow, top, or the name of one of the model's cameras (videos may have both)"
        )
    return CameraRecording(rate_hz, camera, appearance_of(plan), plan.seed)
