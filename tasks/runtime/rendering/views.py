"""Camera views of a model: views that follow the robot or look from above, visible geoms, poses without simulation."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..episode.physics import radius_of, robot_body

View = Callable[[mujoco.MjData], mujoco.MjvCamera]
"""Function that returns the camera's pose for a simulation state."""

FOLLOW, TOP, BOTH = "follow", "top", "both"
SHOWN_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
"""Mask of the geom groups that MuJoCo's viewers show: 0 to 2; groups 3 to 5 are collision shapes by convention."""

_ELEVATION_DEG = -32.0
_STEEPER_DEG, _STEEPEST_DEG = 15.0, -75.0
"""Step in which a camera's elevation gets steeper when something is in between, and the steepest elevation, in degrees;
straight down there is no "behind" any more.
"""
_UPRIGHT = 0.5
"""Cosine of the tilt beyond which a body has fallen, so that its front gives no direction."""
_SIDE_DEG = 55.0
"""Azimuth in degrees at which robots that cannot move are shown: from the side rather than from behind."""
_DISTANCE_RADII = 3.6
_SMOOTHING_S = 0.4
_MARGIN_M = 0.3
_Vector = NDArray[np.float64]


class CameraNameError(ValueError):
    """Raised for a camera name that the model does not have; the message lists the names it has."""


def choose_views(
    model: mujoco.MjModel, name: str | None, said_by: str = "the environment's video_camera", aspect: float = 4 / 3
) -> tuple[View, View | None]:
    """Returns the main camera view of a video, and for `both` the inset view.

    Args:
        model: The model.
        name: Name of the view: `follow`, `top`, `both`, or a camera's name; None: follow, if anything can be followed.
        said_by: Source of the name, for the error message.
        aspect: Width of the picture divided by its height.

    Raises:
        CameraNameError: The model has no camera of that name.
    """
    if name == BOTH:
        return choose_view(model, FOLLOW, said_by, aspect), choose_view(model, TOP, said_by, aspect)
    return choose_view(model, name, said_by, aspect), None


def choose_view(
    model: mujoco.MjModel, name: str | None, said_by: str = "the environment's video_camera", aspect: float = 4 / 3
) -> View:
    """Returns the camera view of a name.

    A camera of the model with that name takes precedence, so that a robot can have its own `follow` and a world its own
    `top`. If a robot's `follow` is fixed to it, the view keeps that camera's distance, side and slope, but not its
    tilt. Cameras of robots are found with and without the robot's name: `front` is `<robot>/front` in the compiled
    world. Without a name the view is the model's `follow`, else its first camera, else a camera that follows the body
    that the actuators move, else MuJoCo's default view.

    Args:
        model: The model.
        name: Name of the view: `follow`, `top` or a camera's name; None: see above.
        said_by: Source of the name, for the error message.
        aspect: Width of the picture divided by its height.

    Raises:
        CameraNameError: The model has no camera of that name.
    """
    camera = _own_camera(model, name or FOLLOW)
    if camera is None and name is None and model.ncam:
        camera = 0
    body = robot_body(model)
    if camera is not None and body is not None and _rides_along(model, camera, body) and name in (None, FOLLOW):
        return FollowView(model, body, camera)
    if camera is not None:
        return _fixed(camera)
    if name == TOP:
        return TopView(model, aspect)
    if name == FOLLOW or (name is None and body is not None):
        return FollowView(model, body) if body is not None else _whole(model)
    if name is None:
        return _whole(model)
    there = ", ".join(model.camera(i).name for i in range(model.ncam)) or "none"
    raise CameraNameError(
        f"{said_by}: there is no camera {name!r}; the model's cameras are: {there}; {FOLLOW} and {TOP} are always there"
    )


class FollowView:
    """Camera view from behind and above a robot, which follows it with a level horizon.

    If a fixed object hides the robot, the camera rises to look over it, and moves closer if that does not help.
    """

    def __init__(self, model: mujoco.MjModel, body: int, camera: int | None = None) -> None:
        """Prepares a camera view that follows a robot.

        Args:
            model: The model.
            body: Root body of the robot to follow.
            camera: Id of a camera on the robot that defines the view at rest; None: from behind, or from the side if
                the robot cannot move.
        """
        self._model, self._body = model, body
        self._radius_m = radius_of(model, body)
        self._distance_m = _DISTANCE_RADII * self._radius_m
        self._elevation_deg, self._side_deg = _ELEVATION_DEG, 0.0 if _roams(model, body) else _SIDE_DEG
        if camera is not None:
            self._stand_like(camera)
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._time_s: float | None = None
        self._heading_deg = 0.0

    def _stand_like(self, camera: int) -> None:
        """Sets distance, side and slope of the view from a camera of the model.

        A narrower field of view needs more distance.
        """
        x, y, z = (float(value) for value in self._model.cam_poscom0[camera])
        narrower = math.tan(math.radians(self._model.cam_fovy[camera] / 2)) / _half_view(self._model)
        self._distance_m = math.hypot(x, y, z) * narrower
        self._side_deg = math.degrees(math.atan2(-y, -x))
        self._elevation_deg = -math.degrees(math.atan2(z, math.hypot(x, y)))

    def __call__(self, data: mujoco.MjData) -> mujoco.MjvCamera:
        """Returns the camera's pose for a state, moving smoothly from its pose at the previous state."""
        place = np.array(data.subtree_com[self._body])
        azimuth_deg = self._turned_to(data) + self._side_deg
        view = self._view
        if self._time_s is None or not 0 <= data.time - self._time_s < 5:
            view.lookat[:], view.azimuth, share = place, azimuth_deg, 1.0
        else:
            # A first-order lag: a gait's nodding does not shake the picture.
            share = 1 - math.exp(-(data.time - self._time_s) / _SMOOTHING_S)
            view.lookat[:] += share * (place - view.lookat)
            view.azimuth += share * ((azimuth_deg - view.azimuth + 180) % 360 - 180)
        elevation_deg, free_m = self._free_stand(data)
        view.elevation += share * (elevation_deg - view.elevation)
        view.distance = free_m if free_m < view.distance else view.distance + share * (free_m - view.distance)
        self._time_s = data.time
        return view

    def _turned_to(self, data: mujoco.MjData) -> float:
        """Returns the robot's heading in degrees; after it has fallen, its heading before."""
        frame = data.xmat[self._body].reshape(3, 3)
        if self._time_s is None or frame[2, 2] > _UPRIGHT:
            self._heading_deg = math.degrees(math.atan2(frame[1, 0], frame[0, 0]))
        return self._heading_deg

    def _free_stand(self, data: mujoco.MjData) -> tuple[float, float]:
        """Returns the elevation in degrees and the distance in metres from which the camera sees the robot freely.

        That is the flattest free view from the full distance, else the one with the farthest free distance.
        """
        best = (self._elevation_deg, 0.0)
        elevation_deg = self._elevation_deg
        while elevation_deg >= min(_STEEPEST_DEG, self._elevation_deg):
            free_m = self._free_distance_m(data, elevation_deg)
            if free_m > best[1]:
                best = (elevation_deg, free_m)
            if free_m >= self._distance_m:
                break
            elevation_deg -= _STEEPER_DEG
        return best

    def _free_distance_m(self, data: mujoco.MjData, elevation_deg: float) -> float:
        """Returns the distance in metres from the robot up to which no fixed geom hides it from the camera."""
        azimuth, elevation = math.radians(self._view.azimuth), math.radians(elevation_deg)
        back = -np.array(
            (math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation))
        )
        start = np.array(self._view.lookat) + self._radius_m * back
        geom = np.zeros(1, dtype=np.int32)
        hit_m = mujoco.mj_ray(self._model, data, start, back, SHOWN_GROUPS, True, self._body, geom, None)
        if hit_m < 0 or self._model.body_weldid[self._model.geom_bodyid[geom[0]]] != 0:
            return self._distance_m
        return min(self._distance_m, self._radius_m + max(0.25 * self._radius_m, hit_m - 0.05))


class TopView:
    """Camera view straight down that frames all fixed geoms, or that follows the robot if the world has none."""

    def __init__(self, model: mujoco.MjModel, aspect: float) -> None:
        """Prepares a camera view from above; positions are read from the first state.

        Args:
            model: The model.
            aspect: Width of the picture divided by its height.
        """
        self._model, self._aspect = model, aspect
        self._body: int | None = None
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FREE
        # North is up and east is right, as on a map.
        self._view.azimuth, self._view.elevation = 90.0, -90.0
        self._ready = False

    def __call__(self, data: mujoco.MjData) -> mujoco.MjvCamera:
        """Returns the view from above for a state, centred on the robot if the view follows it."""
        if not self._ready:
            self._prepare(data)
        if self._body is not None:
            self._view.lookat[:] = data.subtree_com[self._body]
        return self._view

    def _prepare(self, data: mujoco.MjData) -> None:
        self._ready = True
        model, view = self._model, self._view
        box = fixed_extent(model, data)
        if box is not None:
            low, high = box
            view.lookat[:] = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[2])
            half_m = max((high[1] - low[1]) / 2, (high[0] - low[0]) / 2 / self._aspect) + _MARGIN_M
        else:
            self._body = robot_body(model)
            view.lookat[:] = model.stat.center
            half_m = 2.5 * radius_of(model, self._body) if self._body is not None else model.stat.extent
        view.distance = half_m / _half_view(model)


def fixed_extent(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[_Vector, _Vector] | None:
    """Returns the lower and upper corners, in metres, of the visible fixed geometry's bounding box.

    Returns `None` if there is only a floor.
    """
    solid = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE.value
    fixed = model.body_weldid[model.geom_bodyid] == 0
    shown = SHOWN_GROUPS[np.clip(model.geom_group, 0, 5)].astype(bool) & (model.geom_rgba[:, 3] > 0)
    geoms = np.flatnonzero(solid & fixed & shown)
    if not len(geoms):
        return None
    axes = data.geom_xmat[geoms].reshape(-1, 3, 3)
    middle = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", axes, model.geom_aabb[geoms, :3])
    half = np.einsum("gij,gj->gi", np.abs(axes), model.geom_aabb[geoms, 3:])
    return (middle - half).min(axis=0), (middle + half).max(axis=0)


def _own_camera(model: mujoco.MjModel, name: str) -> int | None:
    camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
    if camera >= 0:
        return camera
    # Of all that is fixed there is one view from above; a robot's own `top` is asked for with the robot's name.
    attached = (i for i in range(model.ncam) if name != TOP and model.camera(i).name.endswith(f"/{name}"))
    return next(attached, None)


def _rides_along(model: mujoco.MjModel, camera: int, body: int) -> bool:
    """Returns whether a camera is fixed to a body that moves freely, so that it tips over with it."""
    is_fixed = int(model.cam_mode[camera]) == mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value
    return is_fixed and int(model.cam_bodyid[camera]) == body and _roams(model, body)


def _roams(model: mujoco.MjModel, body: int) -> bool:
    first = int(model.jnt_type[model.body_jntadr[body]]) if model.body_jntnum[body] else None
    # As a plain number: a member of an enumeration is not equal to a number of numpy.
    return first == mujoco.mjtJoint.mjJNT_FREE.value


def _half_view(model: mujoco.MjModel) -> float:
    """Returns the tangent of half the vertical field of view of free cameras."""
    return math.tan(math.radians(model.vis.global_.fovy / 2))


def _fixed(camera: int) -> View:
    view = mujoco.MjvCamera()
    view.type = mujoco.mjtCamera.mjCAMERA_FIXED
    view.fixedcamid = camera
    return lambda _: view


def _whole(model: mujoco.MjModel) -> View:
    view = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, view)
    return lambda _: view


MODEL_BORROWED = threading.Lock()
"""Lock held while geoms of a model are in a hidden group; other threads must not copy a model meanwhile."""

_HIDDEN_GROUP = 5
_UNSEEN_MARGIN_M = 0.01
_ROOFS = ("ceiling_", "lamp_")


def roofs(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Returns the numbers of the geoms that are ceilings, which are shown from below only."""
    meshes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH.value)
    return np.array([geom for geom in meshes if model.geom(int(geom)).name.startswith(_ROOFS)], np.intp)


@contextmanager
def hidden(model: mujoco.MjModel, geoms: NDArray[np.intp]) -> Iterator[None]:
    """Hides geoms inside the `with` block, while a picture is rendered; other threads that change the model wait."""
    groups = model.geom_group[geoms]
    with MODEL_BORROWED:
        model.geom_group[geoms] = _HIDDEN_GROUP
        try:
            yield
        finally:
            model.geom_group[geoms] = groups


@contextmanager
def without_unseen(model: mujoco.MjModel, data: mujoco.MjData, scene: mujoco.MjvScene, aspect: float) -> Iterator[None]:
    """Hides geoms outside a camera's view inside the `with` block, to render faster.

    Args:
        model: Compiled model; its `geom_group` is restored afterwards.
        data: State of the model.
        scene: Scene with the camera, after `mjv_updateCamera`; it must not show group 5.
        aspect: Width of the picture divided by its height.
    """
    unseen = outside(data.geom_xpos, model.geom_rbound, scene, aspect)
    with hidden(model, unseen):
        yield


def outside(middles: _Vector, radii_m: _Vector, scene: mujoco.MjvScene, aspect: float) -> NDArray[np.intp]:
    """Returns the numbers of the spheres that are completely outside a camera's view.

    Args:
        middles: Centres of the spheres in metres, shape (n, 3).
        radii_m: Radii of the spheres; 0 means infinite.
        scene: Scene with the camera.
        aspect: Width of the picture divided by its height.
    """
    left, right = scene.camera  # eyes; what is drawn is seen from between them
    if left.orthographic:
        return np.zeros(0, np.intp)
    forward, up = np.array(left.forward, np.float64), np.array(left.up, np.float64)
    aside = np.cross(forward, up)
    away = middles - (np.array(left.pos, np.float64) + right.pos) / 2
    near, bottom, top = left.frustum_near, left.frustum_bottom, left.frustum_top
    center = (left.frustum_center + right.frustum_center) / 2
    half = max(aspect * (top - bottom) / 2, left.frustum_width)
    inward = np.array(
        [
            forward * (center + half) - aside * near,
            aside * near - forward * (center - half),
            forward * top - up * near,
            up * near - forward * bottom,
            forward,
        ]
    )
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    deepest_m = (away @ inward.T).min(axis=1)
    return np.flatnonzero((deepest_m < -radii_m - _UNSEEN_MARGIN_M) & (radii_m > 0))


def awake(model: mujoco.MjModel) -> mujoco.MjModel:
    """Switches off sleeping bodies in a model, in place, as their poses would not follow `qpos`; returns the model."""
    model.opt.enableflags &= ~mujoco.mjtEnableBit.mjENBL_SLEEP.value
    return model


def work_out_places(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Updates all poses in `data` from its `qpos`, without computing collisions and forces."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    mujoco.mj_flex(model, data)
    mujoco.mj_tendon(model, data)
