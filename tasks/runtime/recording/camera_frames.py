"""Pose and projection of a camera in ROS: transforms, and `sensor_msgs/CameraInfo`.

Frames follow REP 103: a camera's own frame has x forward, y left, z up; its optical frame has z forward, x right, y
down.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from . import messages as ros
from .messages import CameraInfo

CAMERA_FRAME, OPTICAL_FRAME = "camera_link", "camera_optical_frame"
WORLD = "world"
"""Frame name of MuJoCo's body 0, to which all fixed geoms belong."""

TO_OPTICAL = ros.Transform(rotation=ros.Quaternion(-0.5, 0.5, -0.5, 0.5))
"""Rotation from a camera's frame to its optical frame."""

_FROM_MUJOCO = np.array((0.5, -0.5, 0.5, 0.5))
"""Rotation from the axes of MuJoCo's cameras (x right, y up, looking along -z) to a camera's frame, as a quaternion
with w first.
"""

_BODY = mujoco.mjtObj.mjOBJ_BODY.value
_AS = ', such as {"world": "map", "chassis": "base_link"}'


class Mount(NamedTuple):
    """Pose of a camera in a ROS frame, and whether it is fixed to that frame or moves in it."""

    parent: str
    """Name of the frame that the camera is fixed to."""

    transform: ros.Transform
    is_fixed: bool
    """Whether the camera never moves relative to that frame."""


def frames_of(environment: Any, model: mujoco.MjModel) -> Mapping[int, str]:
    """Returns the ROS frame names of an environment's bodies, by body number.

    Args:
        environment: Environment that may have `tf_frames`: frame names by body name, or by the number of bodies without
            a name. Bodies that the model does not have are left out.
        model: Compiled model of the environment.

    Raises:
        TypeError: The `tf_frames` of the environment are not frame names by bodies.
    """
    named = getattr(environment, "tf_frames", {})
    if not isinstance(named, Mapping):
        raise TypeError(
            f"the environment's tf_frames is a {type(named).__name__}; it has to name frames by bodies{_AS}"
        )
    found = {0: WORLD}
    for body, frame in named.items():
        if not _is_text(body) and not isinstance(body, int | np.integer):
            raise TypeError(
                f"the environment's tf_frames has a frame for {body!r}; bodies have to be given by name or number{_AS}"
            )
        if not _is_text(frame):
            raise TypeError(
                f"the environment's tf_frames names {frame!r} for {body!r}; a frame has to be printable text{_AS}"
            )
        found[mujoco.mj_name2id(model, _BODY, body) if isinstance(body, str) else int(body)] = frame
    return {body: frame for body, frame in found.items() if 0 <= body < model.nbody}


def _is_text(value: object) -> bool:
    return isinstance(value, str) and value != "" and value.isprintable()


def find_mount(
    model: mujoco.MjModel, view: mujoco.MjvCamera, scene: mujoco.MjvScene, frames: Mapping[int, str]
) -> Mount:
    """Returns the ROS frame that a camera is fixed to, and the camera's pose there.

    The frame is that of the body that carries the camera, or of a body to which that one is rigidly fixed; else it is
    the world.

    Args:
        model: The model.
        view: Camera.
        scene: Scene after `mjv_updateCamera`.
        frames: Frame names by body number, including the world's.
    """
    if view.type == mujoco.mjtCamera.mjCAMERA_FIXED.value:
        fixed = _fixed_mount(model, view.fixedcamid, frames)
        if fixed is not None:
            return fixed
    eye, other = scene.camera[0], scene.camera[1]
    place = (np.asarray(eye.pos, dtype=float) + other.pos) / 2
    ahead, up = np.asarray(eye.forward, dtype=float), np.asarray(eye.up, dtype=float)
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, np.column_stack((ahead, np.cross(up, ahead), up)).ravel())
    return Mount(frames[0], transform_of(place, turn), is_fixed=False)


def camera_info(header: ros.Header, scene: mujoco.MjvScene, size: tuple[int, int]) -> CameraInfo | None:
    """Makes the ROS `CameraInfo` (projection) of a scene's camera; `None` if it is not a pinhole camera.

    Args:
        header: Time stamp and optical frame.
        scene: Scene after `mjv_updateCamera`.
        size: Width and height of the picture in pixels.
    """
    eye = scene.camera[0]
    if eye.orthographic:
        return None
    width, height = size
    high = eye.frustum_top - eye.frustum_bottom
    # Like `mjr_render`: without a width of its own it is as wide as the picture.
    wide = 2 * eye.frustum_width or high * width / height
    left = eye.frustum_center - wide / 2
    return CameraInfo(
        header,
        height=height,
        width=width,
        fx=eye.frustum_near * width / wide,
        fy=eye.frustum_near * height / high,
        # MuJoCo's frustum ends at the edge of the outermost pixels, which is half a pixel from their middle.
        cx=-left / wide * width - 0.5,
        cy=eye.frustum_top / high * height - 0.5,
    )


def transform_of(place: Any, turn: Any) -> ros.Transform:
    """Makes a ROS transform from a position and a MuJoCo quaternion (w first)."""
    w, x, y, z = map(float, turn)
    return ros.Transform(ros.Vector3(*map(float, place)), ros.Quaternion(x, y, z, w))


def _fixed_mount(model: mujoco.MjModel, camera: int, frames: Mapping[int, str]) -> Mount | None:
    """Returns the ROS frame and pose of a camera with a rigid mount; None if it moves relative to its frame."""
    if model.cam_mode[camera] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value:
        return None
    # From the model's constants, so that it is the same whenever it is worked out.
    place, turn = np.array(model.cam_pos[camera]), np.zeros(4)
    mujoco.mju_mulQuat(turn, model.cam_quat[camera], _FROM_MUJOCO)
    body = int(model.cam_bodyid[camera])
    while body not in frames:
        if model.body_jntnum[body] or model.body_mocapid[body] >= 0:
            return None
        turned, place_before, turn_before = np.zeros(3), place, np.array(turn)
        mujoco.mju_rotVecQuat(turned, place_before, model.body_quat[body])
        place = model.body_pos[body] + turned
        mujoco.mju_mulQuat(turn, model.body_quat[body], turn_before)
        body = int(model.body_parentid[body])
    return Mount(frames[body], transform_of(place, turn), is_fixed=True)
