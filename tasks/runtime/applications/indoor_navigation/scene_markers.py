"""Markers in a recording's scene: goals, and contacts while they last.

Both are `visualization_msgs/MarkerArray`, the one type for such things that RViz and Foxglove draw and that every
ROS 2 distribution has; `ros_gz_interfaces/Contacts` is drawn by neither.
"""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Sequence

import mujoco
import numpy as np

from .....schemas.worlds.world import Room
from ...episode.contact_forces import floor_geoms, geom_names, robot_geoms
from ...recording import messages as ros
from ...recording.display_messages import ColorRGBA, Marker, MarkerArray, MarkerType
from ...recording.recorder import Recorder

CONTACT_RATE_HZ = 50.0
ARROW_M_PER_N = 0.01
"""Length of a contact's arrow for its normal force."""

_LIFETIME = ros.Time.from_seconds(0.1)
_FRAME = "map"
_ROUNDING_S = 1e-6
_SHAFT = ros.Vector3(0.02, 0.04, 0.0)
"""Diameters of an arrow's shaft and head."""

_DISC = ros.Vector3(0.3, 0.3, 0.01)
_LETTERS = ros.Vector3(z=0.2)
_RED, _ORANGE, _GREEN = ColorRGBA(0.9, 0.1, 0.1), ColorRGBA(1.0, 0.6, 0.1, 0.8), ColorRGBA(0.2, 0.8, 0.3, 0.8)


def goal_markers(rooms: Sequence[Room], visited: Sequence[bool], time_s: float) -> MarkerArray:
    """Returns a disc and a name per room; green where the robot has been.

    Args:
        rooms: the rooms, each with its goal.
        visited: which of them the robot has been in.
        time_s: simulated time.
    """
    header = ros.Header(ros.Time.from_seconds(time_s), _FRAME)
    markers = []
    for number, (room, done) in enumerate(zip(rooms, visited, strict=True)):
        colour, (x, y) = _GREEN if done else _ORANGE, room.goal
        for kind, scale, height in ((MarkerType.CYLINDER, _DISC, 0.005), (MarkerType.TEXT_VIEW_FACING, _LETTERS, 0.6)):
            pose = ros.Pose(ros.Vector3(x, y, height))
            text = room.name if kind is MarkerType.TEXT_VIEW_FACING else ""
            space = "goals" if kind is MarkerType.CYLINDER else "names"
            markers.append(Marker(header, space, number, kind, pose, scale, colour, text=text))
    return MarkerArray(markers)


class ContactMarkers:
    """Publishes an arrow per contact of the robot with anything but itself and the floor.

    An arrow begins at the contact and points where the robot is pushed, 1 cm per newton of normal force. Its `ns` is
    what is touched, its `text` the force.
    """

    def __init__(
        self,
        recorder: Recorder,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot_body_id: int,
        furniture_ids: Sequence[str],
    ) -> None:
        """Looks up the bodies and geoms.

        Args:
            recorder: where they go.
            model: the compiled world with the robot.
            data: its state, after `mj_forward`.
            robot_body_id: a body of the robot.
            furniture_ids: prefixes of geom names that name pieces of furniture.
        """
        self._recorder, self._model, self._data = recorder, model, data
        self._robot, self._floor = robot_geoms(model, robot_body_id), floor_geoms(model, data)
        self._names = geom_names(model, furniture_ids)
        self._due_s = 0.0
        self._wrench = np.zeros(6)

    def publish(self) -> None:
        """Publishes the present contacts, at most 50 times a second; to be called while there are any."""
        time_s = self._data.time
        if time_s < self._due_s and self._due_s < time_s + 2 / CONTACT_RATE_HZ:  # else the time began anew
            return
        self._due_s = time_s + 1 / CONTACT_RATE_HZ - _ROUNDING_S
        pairs = self._data.contact.geom
        touching = (self._robot[pairs].sum(axis=1) == 1) & ~self._floor[pairs].any(axis=1)
        header = ros.Header(ros.Time.from_seconds(time_s), _FRAME)
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
