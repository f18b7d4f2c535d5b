"""Views for video: a model's own cameras, one that follows the robot, one straight from above."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..episode.robot_body import radius_of, robot_body

View = Callable[[mujoco.MjData], mujoco.MjvCamera]
"""Says for a state where the camera stands and looks."""

FOLLOW, TOP, BOTH = "follow", "top", "both"
SHOWN_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
"""MuJoCo's viewers show groups 0 to 2; 3 to 5 are collision shapes by custom."""

_ELEVATION_DEG = -32.0
_SIDE_DEG = 55.0
"""What stands still is seen from the side rather than from behind."""
_DISTANCE_RADII = 3.6
_SMOOTHING_S = 0.4
_MARGIN_M = 0.3
_Vector = NDArray[np.float64]


class CameraNameError(ValueError):
    """A camera was asked for that the model does not have; the message says by what, and which there are."""


def choose_views(
    model: mujoco.MjModel, name: str | None, said_by: str = "the environment's video_camera", aspect: float = 4 / 3
) -> tuple[View, View | None]:
    """Returns the main view, and the one shown small in a corner for `both`.

    Args:
        model: The model.
        name: `follow`, `top`, `both`, or a camera's name; None: follow, if there is anything to follow.
        said_by: Where the name comes from, for the error.
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
    """Returns one view.

    A camera of the model goes first, so a robot may bring its own `follow` and a world its own `top`. Cameras of
    robots are found with and without the robot's name: `front` is `<robot>/front` once it is attached. Without a
    name it is the model's `follow`, else its first camera, else a camera made to follow what the actuators move,
    else MuJoCo's own view of the whole.

    Args:
        model: The model.
        name: See `choose_views`, except `both`.
        said_by: See `choose_views`.
        aspect: See `choose_views`.

    Raises:
        CameraNameError: The model has no camera of that name.
    """
    camera = _own_camera(model, name or FOLLOW)
    if camera is None and name is None and model.ncam:
        camera = 0
    if camera is not None:
        return _fixed(camera)
    if name == TOP:
        return TopView(model, aspect)
    body = robot_body(model)
    if name == FOLLOW or (name is None and body is not None):
        return FollowView(model, body) if body is not None else _whole(model)
    if name is None:
        return _whole(model)
    there = ", ".join(model.camera(i).name for i in range(model.ncam)) or "none"
    raise CameraNameError(
        f"{said_by}: there is no camera {name!r}; the model's cameras are: {there}; {FOLLOW} and {TOP} are always there"
    )


class FollowView:
    """Stands behind a robot and above it, turns with it slowly, comes closer where a wall is in between."""

    def __init__(self, model: mujoco.MjModel, body: int) -> None:
        """Prepares the view.

        Args:
            model: The model.
            body: Root body of what is followed.
        """
        self._model, self._body = model, body
        self._radius_m = radius_of(model, body)
        self._distance_m = _DISTANCE_RADII * self._radius_m
        # As a plain number: a member of an enumeration is not equal to a number of numpy.
        first = int(model.jnt_type[model.body_jntadr[body]]) if model.body_jntnum[body] else None
        roams = first == mujoco.mjtJoint.mjJNT_FREE.value
        self._side_deg = 0.0 if roams else _SIDE_DEG
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._view.elevation = _ELEVATION_DEG
        self._time_s: float | None = None

    def __call__(self, data: mujoco.MjData) -> mujoco.MjvCamera:
        """Moves the camera on to the state's time."""
        place = np.array(data.subtree_com[self._body])
        heading_deg = self._heading_deg(data) + self._side_deg
        view = self._view
        if self._time_s is None or not 0 <= data.time - self._time_s < 5:
            view.lookat[:], view.azimuth, share = place, heading_deg, 1.0
        else:
            # A first-order lag: a gait's nodding does not shake the picture.
            share = 1 - math.exp(-(data.time - self._time_s) / _SMOOTHING_S)
            view.lookat[:] += share * (place - view.lookat)
            view.azimuth += share * ((heading_deg - view.azimuth + 180) % 360 - 180)
        free_m = self._free_distance_m(data)
        view.distance = free_m if free_m < view.distance else view.distance + share * (free_m - view.distance)
        self._time_s = data.time
        return view

    def _heading_deg(self, data: mujoco.MjData) -> float:
        x, y = data.xmat[self._body].reshape(3, 3)[:2, 0]
        if math.hypot(x, y) < 0.2:  # it stands on its head or tail: no heading to speak of
            return self._view.azimuth - self._side_deg if self._time_s is not None else 0.0
        return math.degrees(math.atan2(y, x))

    def _free_distance_m(self, data: mujoco.MjData) -> float:
        """How far back the camera can stand before something fixed comes between it and the robot."""
        azimuth, elevation = math.radians(self._view.azimuth), math.radians(_ELEVATION_DEG)
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
    """Looks straight down on everything that is fixed, or on the robot where nothing is."""

    def __init__(self, model: mujoco.MjModel, aspect: float) -> None:
        """Prepares the view; where things are is read from the first state.

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
        """Follows the robot if that is what it looks at."""
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
        view.distance = half_m / math.tan(math.radians(model.vis.global_.fovy / 2))


def fixed_extent(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[_Vector, _Vector] | None:
    """Returns the lowest and highest corner of what is fixed and shown; None when that is at most a floor."""
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


def _fixed(camera: int) -> View:
    view = mujoco.MjvCamera()
    view.type = mujoco.mjtCamera.mjCAMERA_FIXED
    view.fixedcamid = camera
    return lambda _: view


def _whole(model: mujoco.MjModel) -> View:
    view = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, view)
    return lambda _: view
