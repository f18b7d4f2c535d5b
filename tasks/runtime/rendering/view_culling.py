"""View culling: finds the geoms that a camera can see at all.

MuJoCo's renderer draws all geoms, also those behind the camera. Of a furnished home most is behind the camera
or beside the picture, and drawing it takes most of a picture's time on a CPU.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray

MODEL_BORROWED = threading.Lock()
"""Held while geoms of a model are in a group that is not shown; other threads must not copy a model meanwhile."""

_HIDDEN_GROUP = 5
_MARGIN_M = 0.01
_ROOFS = ("ceiling_", "lamp_")
_Vector = NDArray[np.float64]


def roofs(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Numbers of the geoms that worlds show from below only: trays that are open at the top."""
    meshes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH.value)
    return np.array([geom for geom in meshes if model.geom(int(geom)).name.startswith(_ROOFS)], np.intp)


@contextmanager
def hidden(model: mujoco.MjModel, geoms: NDArray[np.intp]) -> Iterator[None]:
    """Hides geoms for as long as a picture is made of the rest; their `geom_group` is as before afterwards."""
    groups = model.geom_group[geoms]
    with MODEL_BORROWED:
        model.geom_group[geoms] = _HIDDEN_GROUP
        try:
            yield
        finally:
            model.geom_group[geoms] = groups


@contextmanager
def without_unseen(model: mujoco.MjModel, data: mujoco.MjData, scene: mujoco.MjvScene, aspect: float) -> Iterator[None]:
    """Hides geoms that lie outside of a camera's view, for as long as a scene is made of the rest.

    Args:
        model: Its `geom_group` is as before afterwards.
        data: Its state.
        scene: Its camera is the one that looks, after `mjv_updateCamera`; it must not show group 5.
        aspect: Width of the picture divided by its height.
    """
    unseen = outside(data.geom_xpos, model.geom_rbound, scene, aspect)
    with hidden(model, unseen):
        yield


def outside(middles: _Vector, radii_m: _Vector, scene: mujoco.MjvScene, aspect: float) -> NDArray[np.intp]:
    """Returns the numbers of spheres of which nothing is in the view frustum of a scene's camera.

    Args:
        middles: Of the spheres, metres, shape (n, 3).
        radii_m: Their radii; 0 means without an end.
        scene: Has the camera.
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
    return np.flatnonzero((deepest_m < -radii_m - _MARGIN_M) & (radii_m > 0))
