"""What a world and a robot look like to RViz and Foxglove: a map and markers, sent once since they do not change."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import re
from collections.abc import Iterable

import mujoco
import numpy as np
from numpy.typing import NDArray

from .. import messages as ros
from ..display_messages import ColorRGBA, Marker, MarkerArray, MarkerType, OccupancyGrid
from ..ray_camera import geom_colours
from ..views import SHOWN_GROUPS
from .occupancy_map import OccupancyMap

_GEOM = mujoco.mjtGeom
_SHAPES = {
    int(_GEOM.mjGEOM_SPHERE): MarkerType.SPHERE,
    int(_GEOM.mjGEOM_ELLIPSOID): MarkerType.SPHERE,
    int(_GEOM.mjGEOM_CYLINDER): MarkerType.CYLINDER,
    int(_GEOM.mjGEOM_CAPSULE): MarkerType.CYLINDER,
}
"""Of other geoms, such as meshes, the box around them is drawn."""

_WALLS, _WALL_OPACITY = ("wall", "window"), 0.3
_FLOOR_M = 0.005
"""What ends this close to the height 0 is floor."""

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
    model: mujoco.MjModel, data: mujoco.MjData, body: int, wheels: Iterable[int], frame_id: str, stamp: ros.Time
) -> MarkerArray:
    """Returns what is rigidly part of a robot's body, and its wheels, which look the same however they are turned.

    They move with their frame.

    Args:
      model: the compiled world with the robot.
      data: its state, after `mj_forward`.
      body: the body that the frame belongs to.
      wheels: bodies that turn.
      frame_id: the frame.
      stamp: simulated time.
    """
    parts = [int(model.body_weldid[part]) for part in (body, *wheels)]
    own = _shown(model) & np.isin(model.body_weldid[model.geom_bodyid], parts)
    pattern = Marker(ros.Header(stamp, frame_id), "", 0, MarkerType.CUBE, frame_locked=True)
    return MarkerArray(_markers(model, data, own, (data.xpos[body], data.xquat[body]), pattern))


def _shown(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Geoms that cameras see, without endless planes."""
    shown = SHOWN_GROUPS[np.clip(model.geom_group, 0, 5)].astype(bool) & (model.geom_rgba[:, 3] > 0)
    return shown & (model.geom_type != _GEOM.mjGEOM_PLANE.value)


def _markers(
    model: mujoco.MjModel, data: mujoco.MjData, chosen: NDArray[np.bool_], frame: Pose, pattern: Marker
) -> list[Marker]:
    """Markers of geoms, seen from a frame; `ns` is what a geom's name begins with, so that kinds can be hidden."""
    colours = geom_colours(model)
    markers = []
    for geom in np.flatnonzero(chosen).tolist():
        kind = _SHAPES.get(int(model.geom_type[geom]), MarkerType.CUBE)
        (x, y, z), turn = _seen_from(frame, data, geom, model.geom_aabb[geom, :3])
        red, green, blue = colours[geom].tolist()
        colour = ColorRGBA(red, green, blue, float(model.geom_rgba[geom, 3]))
        name = re.split(r"[^A-Za-z]", model.geom(geom).name.rpartition("/")[2], maxsplit=1)[0]
        pose = ros.Pose(ros.Vector3(x, y, z), turn)
        # A box around a geom is as large as the geom; along a capsule it reaches as far as its round ends.
        size = ros.Vector3(*(2 * model.geom_aabb[geom, 3:]).tolist())
        markers.append(pattern._replace(ns=name or "parts", id=geom, type=kind, pose=pose, scale=size, color=colour))
    return markers


def _unobtrusive(shape: Marker) -> Marker:
    """Lowers floors a little below maps and plans, and lets one look through walls."""
    x, y, z = shape.pose.position
    if abs(z + shape.scale.z / 2) < _FLOOR_M:
        return shape._replace(pose=shape.pose._replace(position=ros.Vector3(x, y, z - 2 * _FLOOR_M)))
    if shape.ns in _WALLS:
        return shape._replace(color=shape.color._replace(a=_WALL_OPACITY))
    return shape


def _seen_from(
    frame: Pose, data: mujoco.MjData, geom: int, middle: NDArray[np.float64]
) -> tuple[list[float], ros.Quaternion]:
    """Where the middle of a geom's box is, and how it is turned."""
    axes = data.geom_xmat[geom]
    place, turn = data.geom_xpos[geom] + axes.reshape(3, 3) @ middle, np.zeros(4)
    mujoco.mju_mat2Quat(turn, axes)
    back, back_turn, seen, seen_turn = np.zeros(3), np.zeros(4), np.zeros(3), np.zeros(4)
    mujoco.mju_negPose(back, back_turn, frame[0], frame[1])
    mujoco.mju_mulPose(seen, seen_turn, back, back_turn, place, turn)
    w, x, y, z = seen_turn.tolist()
    return seen.tolist(), ros.Quaternion(x, y, z, w)
