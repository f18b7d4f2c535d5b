"""Shapes of world and robot for RViz and Foxglove: a map and markers, sent once since they do not change."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import re
from collections.abc import Iterable, Iterator, Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...recording import messages as ros
from ...recording.display_messages import ColorRGBA, Marker, MarkerArray, MarkerType, OccupancyGrid
from ...rendering.ray_camera import geom_colours
from ...rendering.views import SHOWN_GROUPS
from .occupancy_map import OccupancyMap

_GEOM = mujoco.mjtGeom
_SHAPES = {
    int(_GEOM.mjGEOM_SPHERE): MarkerType.SPHERE,
    int(_GEOM.mjGEOM_ELLIPSOID): MarkerType.SPHERE,
    int(_GEOM.mjGEOM_CYLINDER): MarkerType.CYLINDER,
    int(_GEOM.mjGEOM_CAPSULE): MarkerType.CYLINDER,
}
"""Marker types of geoms; other geoms, such as meshes, are drawn as the box around them."""

_WALLS, _WALL_OPACITY = ("wall", "window"), 0.3
_FLOOR_M = 0.005
"""Distance from the height 0 within which a shape's top counts as floor, in metres."""

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Position, and a quaternion with w first."""


def occupancy_grid(known: OccupancyMap, header: ros.Header) -> OccupancyGrid:
    """Returns a map as Nav2's map server publishes it.

    Args:
        known: the map.
        header: when, and in which frame.
    """
    cells = np.where(known.free, 0, -1).astype(np.int8)
    if known.occupied is not None:
        cells[known.occupied] = 100
    rows, columns = cells.shape
    origin = ros.Pose(ros.Vector3(*known.origin))
    return OccupancyGrid(header, known.resolution_m, columns, rows, origin, cells.tobytes())


def world_markers(model: mujoco.MjModel, data: mujoco.MjData, frame_id: str, stamp: ros.Time) -> MarkerArray:
    """Returns what is fixed and shown: floors, walls, furniture.

    Args:
        model: the compiled world.
        data: its state, after `mj_forward`.
        frame_id: frame of the world.
        stamp: simulated time.
    """
    fixed = _shown(model) & (model.body_weldid[model.geom_bodyid] == 0)
    pattern = Marker(ros.Header(stamp, frame_id), "", 0, MarkerType.CUBE)
    shapes = _markers(model, data, fixed, (np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0))), pattern)
    return MarkerArray([_unobtrusive(shape) for shape in shapes])


def robot_markers(
    model: mujoco.MjModel, data: mujoco.MjData, frames: Mapping[int, str], wheels: Iterable[int], stamp: ros.Time
) -> MarkerArray:
    """Returns what a robot looks like; its parts move with their frames.

    Args:
        model: the compiled world with the robot.
        data: its state, after `mj_forward`.
        frames: frames by body, the base's first; what is rigidly fixed to a body is seen from its frame.
        wheels: bodies without frames that are drawn in the base's, since they look the same however they are turned.
        stamp: simulated time.
    """
    shown, group = _shown(model), model.body_weldid[model.geom_bodyid]
    markers = []
    for number, (body, frame) in enumerate(frames.items()):
        parts = [int(model.body_weldid[body]), *(wheels if number == 0 else ())]
        pattern = Marker(ros.Header(stamp, frame), "", 0, MarkerType.CUBE, frame_locked=True)
        pose = data.xpos[body], data.xquat[body]
        markers += _markers(model, data, shown & np.isin(group, parts), pose, pattern)
    return MarkerArray(markers)


def _shown(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Geoms that cameras see, without endless planes."""
    shown = SHOWN_GROUPS[np.clip(model.geom_group, 0, 5)].astype(bool) & (model.geom_rgba[:, 3] > 0)
    return shown & (model.geom_type != _GEOM.mjGEOM_PLANE.value)


def _markers(
    model: mujoco.MjModel, data: mujoco.MjData, chosen: NDArray[np.bool_], frame: Pose, pattern: Marker
) -> list[Marker]:
    """Markers of geoms, seen from a frame; `ns` is what a geom's name begins with, so that kinds can be hidden."""
    geoms = np.flatnonzero(chosen)
    kinds = [_SHAPES.get(kind, MarkerType.CUBE) for kind in model.geom_type[geoms].tolist()]
    # A box around a geom is as large as the geom; along a capsule it reaches as far as its round ends.
    sizes = (2 * model.geom_aabb[geoms, 3:]).tolist()
    colours = np.column_stack((geom_colours(model, geoms), model.geom_rgba[geoms, 3])).tolist()
    header, locked = pattern.header, pattern.frame_locked
    return [
        Marker(
            header, _kind_of_name(model, geom), geom, kind, pose, ros.Vector3(*size), ColorRGBA(*colour),
            frame_locked=locked,
        )
        for geom, kind, pose, size, colour in zip(
            geoms.tolist(), kinds, _poses(model, data, geoms, frame), sizes, colours, strict=True
        )
    ]  # fmt: skip


def _kind_of_name(model: mujoco.MjModel, geom: int) -> str:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or ""
    return re.split(r"[^A-Za-z]", name.rpartition("/")[2], maxsplit=1)[0] or "parts"


def _unobtrusive(shape: Marker) -> Marker:
    """Lowers floors a little below maps and plans, and lets one look through walls."""
    x, y, z = shape.pose.position
    if abs(z + shape.scale.z / 2) < _FLOOR_M:
        return shape._replace(pose=shape.pose._replace(position=ros.Vector3(x, y, z - 2 * _FLOOR_M)))
    if shape.ns in _WALLS:
        return shape._replace(color=shape.color._replace(a=_WALL_OPACITY))
    return shape


def _poses(model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.intp], frame: Pose) -> Iterator[ros.Pose]:
    """Yields the poses of the middles of geoms' boxes, seen from a frame."""
    own = np.zeros(9)
    mujoco.mju_quat2Mat(own, frame[1])
    axes = data.geom_xmat[geoms].reshape(-1, 3, 3)
    places = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", axes, model.geom_aabb[geoms, :3])
    turn = own.reshape(3, 3).T
    quaternion = np.zeros(4)
    for place, turned in zip(((places - frame[0]) @ turn.T).tolist(), (turn @ axes).reshape(-1, 9), strict=True):
        mujoco.mju_mat2Quat(quaternion, turned)
        w, x, y, z = quaternion.tolist()
        yield ros.Pose(ros.Vector3(*place), ros.Quaternion(x, y, z, w))
