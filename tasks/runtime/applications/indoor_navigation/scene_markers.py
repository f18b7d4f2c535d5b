"""ROS markers for a recording: goals, contacts, the world, the robot, and the map."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from .....schemas.worlds.world import Room
from ...episode.occupancy_map import OccupancyMap
from ...episode.physics import floor_geoms, geom_names, robot_geoms
from ...recording import messages as ros
from ...recording.messages import ColorRGBA, Marker, MarkerArray, MarkerType, OccupancyGrid
from ...recording.recording import Recorder
from ...rendering.ray_camera import geom_colours
from ...rendering.views import SHOWN_GROUPS

CONTACT_RATE_HZ = 50.0
ARROW_M_PER_N = 0.01
"""Length of a contact's arrow per newton of normal force."""

_LIFETIME = ros.Time.from_seconds(0.1)
_ROUNDING_S = 1e-6
_SHAFT = ros.Vector3(0.02, 0.04, 0.0)
"""Diameters of an arrow's shaft and head, in metres."""

_DISC = ros.Vector3(0.3, 0.3, 0.01)
_LETTERS = ros.Vector3(z=0.2)
_RED, _ORANGE, _GREEN = ColorRGBA(0.9, 0.1, 0.1), ColorRGBA(1.0, 0.6, 0.1, 0.8), ColorRGBA(0.2, 0.8, 0.3, 0.8)


def goal_markers(rooms: Sequence[Room], visited: Sequence[bool], time_s: float, frame: str) -> MarkerArray:
    """Makes ROS markers for the goals: a disc and a name in each room, green once visited.

    Args:
        rooms: The rooms, each with its goal.
        visited: Whether the robot has been in each room.
        time_s: Simulated time of the message.
        frame: Name of the map's ROS frame.
    """
    header = ros.Header(ros.Time.from_seconds(time_s), frame)
    markers = []
    for number, (room, done) in enumerate(zip(rooms, visited, strict=True)):
        colour, (x, y) = _GREEN if done else _ORANGE, room.goal
        for kind, scale, height in ((MarkerType.CYLINDER, _DISC, 0.005), (MarkerType.TEXT_VIEW_FACING, _LETTERS, 0.6)):
            pose = ros.Pose(ros.Vector3(x, y, height))
            text = room.called if kind is MarkerType.TEXT_VIEW_FACING else ""
            space = "goals" if kind is MarkerType.CYLINDER else "names"
            markers.append(Marker(header, space, number, kind, pose, scale, colour, text=text))
    return MarkerArray(markers)


class ContactMarkers:
    """Publishes ROS arrow markers for the robot's contacts, for display in a recording.

    An arrow begins at the contact and points in the direction of the force on the robot, 1 cm per newton of normal
    force. Its `ns` names the touched object, its `text` the force.
    """

    def __init__(
        self,
        recorder: Recorder,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot_body_id: int,
        furniture_ids: Sequence[str],
    ) -> None:
        """Looks up the robot's bodies and geoms, whose contacts are to be drawn.

        Args:
            recorder: Recorder that gets the markers.
            model: The compiled world with the robot.
            data: State of the model, after `mj_forward`.
            robot_body_id: A body of the robot.
            furniture_ids: Prefixes of geom names that name pieces of furniture.
        """
        self._recorder, self._model, self._data = recorder, model, data
        self._robot, self._floor = robot_geoms(model, robot_body_id), floor_geoms(model, data)
        self._names = geom_names(model, furniture_ids)
        self._due_s = 0.0
        self._wrench = np.zeros(6)

    def publish(self) -> None:
        """Records the robot's current contacts, except with the floor, as ROS markers, at most 50 times a second."""
        time_s = self._data.time
        if time_s < self._due_s and self._due_s < time_s + 2 / CONTACT_RATE_HZ:  # else the time began anew
            return
        self._due_s = time_s + 1 / CONTACT_RATE_HZ - _ROUNDING_S
        pairs = self._data.contact.geom
        touching = (self._robot[pairs].sum(axis=1) == 1) & ~self._floor[pairs].any(axis=1)
        header = ros.Header(ros.Time.from_seconds(time_s), self._recorder.frames.map)
        markers = [self._arrow(header, index) for index in np.flatnonzero(touching).tolist()]
        if markers:
            self._recorder.write("/contacts", MarkerArray(markers), time_s)

    def _arrow(self, header: ros.Header, index: int) -> Marker:
        contact = self._data.contact[index]
        mujoco.mj_contactForce(self._model, self._data, index, self._wrench)
        force = abs(float(self._wrench[0]))
        first, second = contact.geom.tolist()
        # The normal points from the first geom to the second one.
        away = -1.0 if self._robot[first] else 1.0
        end = contact.pos + contact.frame[:3] * (away * force * ARROW_M_PER_N)
        points = ros.Vector3(*contact.pos.tolist()), ros.Vector3(*end.tolist())
        return Marker(
            header, self._names[second if self._robot[first] else first], index, MarkerType.ARROW, scale=_SHAFT,
            color=_RED, lifetime=_LIFETIME, points=points, text=f"{force:.1f} N",
        )  # fmt: skip


_GEOM = mujoco.mjtGeom
_SHAPES = {
    int(_GEOM.mjGEOM_SPHERE): MarkerType.SPHERE,
    int(_GEOM.mjGEOM_ELLIPSOID): MarkerType.SPHERE,
    int(_GEOM.mjGEOM_CYLINDER): MarkerType.CYLINDER,
    int(_GEOM.mjGEOM_CAPSULE): MarkerType.CYLINDER,
}
"""ROS marker type of each MuJoCo geom type; other geoms, such as meshes, are drawn as their bounding box."""

_WALLS, _WALL_OPACITY = ("wall", "window"), 0.3
_FLOOR_M = 0.005
"""Largest height in metres of a shape's top at which it counts as floor."""

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Pose: position in metres, and unit quaternion with w first."""


def occupancy_grid(known: OccupancyMap, header: ros.Header) -> OccupancyGrid:
    """Converts a map to a ROS `OccupancyGrid` message, as Nav2's map server publishes it.

    Args:
        known: Occupancy map to convert.
        header: Time stamp and frame of the message.
    """
    cells = np.where(known.free, 0, -1).astype(np.int8)
    if known.occupied is not None:
        cells[known.occupied] = 100
    rows, columns = cells.shape
    origin = ros.Pose(ros.Vector3(*known.origin))
    return OccupancyGrid(header, known.resolution_m, columns, rows, origin, cells.tobytes())


def world_markers(model: mujoco.MjModel, data: mujoco.MjData, frame_id: str, stamp: ros.Time) -> MarkerArray:
    """Makes ROS markers that show the fixed parts of a world: floors, walls, furniture.

    Args:
        model: The compiled world.
        data: State of the model, after `mj_forward`.
        frame_id: ROS frame of the world.
        stamp: Simulated time of the message.
    """
    fixed = _shown(model) & (model.body_weldid[model.geom_bodyid] == 0)
    pattern = Marker(ros.Header(stamp, frame_id), "", 0, MarkerType.CUBE)
    shapes = _markers(model, data, fixed, (np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0))), pattern)
    return MarkerArray([_unobtrusive(shape) for shape in shapes])


def robot_markers(
    model: mujoco.MjModel, data: mujoco.MjData, frames: Mapping[int, str], wheels: Iterable[int], stamp: ros.Time
) -> MarkerArray:
    """Makes ROS markers for a robot's shape; each part moves with the ROS frame of its body.

    Args:
        model: The compiled world with the robot.
        data: State of the model, after `mj_forward`.
        frames: ROS frame name by body number, the base's first; rigidly attached parts use their body's frame.
        wheels: Bodies without ROS frames that are drawn in the base's frame, since they look the same at every angle.
        stamp: Simulated time of the message.
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
    """Returns a mask of the geoms that cameras see, without infinite planes."""
    shown = SHOWN_GROUPS[np.clip(model.geom_group, 0, 5)].astype(bool) & (model.geom_rgba[:, 3] > 0)
    return shown & (model.geom_type != _GEOM.mjGEOM_PLANE.value)


def _markers(
    model: mujoco.MjModel, data: mujoco.MjData, chosen: NDArray[np.bool_], frame: Pose, pattern: Marker
) -> list[Marker]:
    """Makes a ROS marker for each chosen geom; `ns` is the prefix of the geom's name, so kinds can be hidden.

    Args:
        model: The model.
        data: Its present state.
        chosen: Geoms that get markers, shape (geoms,).
        frame: Pose of the frame in which the markers are placed.
        pattern: Marker with the header and the locking of all markers.
    """
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
    """Returns a marker that hides less: a floor a little below maps and plans, a wall translucent; others unchanged."""
    x, y, z = shape.pose.position
    if abs(z + shape.scale.z / 2) < _FLOOR_M:
        return shape._replace(pose=shape.pose._replace(position=ros.Vector3(x, y, z - 2 * _FLOOR_M)))
    if shape.ns in _WALLS:
        return shape._replace(color=shape.color._replace(a=_WALL_OPACITY))
    return shape


def _poses(model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.intp], frame: Pose) -> Iterator[ros.Pose]:
    """Yields the poses of the bounding boxes of some geoms, relative to a frame, in metres."""
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
