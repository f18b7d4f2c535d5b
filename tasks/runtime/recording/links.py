"""Forward kinematics of a robot's links for `/tf`, from its joints, for many times at once.

It does what `robot_state_publisher` does with a URDF, but from the compiled model. MuJoCo's own kinematics would need a
pass for every single state.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

_Numbers = NDArray[np.float64]
_Pose = tuple[_Numbers, _Numbers]
"""Positions, and quaternions with w first; a row per time."""

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_XYZW = (1, 2, 3, 0)


@dataclass(frozen=True)
class Link:
    """A robot's body that its own hinges and slides move, as a ROS link below the link of its parent."""

    body: int
    parent_frame: str
    frame: str
    """Frame name: the body's name in the model, or `link_` and its number."""

    start: _Pose
    """Pose in the parent's frame while the joints are in the model's reference position."""

    joints: tuple[int, ...]


class Links:
    """Bodies of one robot that joints move, as ROS links, with the poses of all of them for many times at once."""

    def __init__(self, model: mujoco.MjModel, base: int, base_frame: str, without: Iterable[int] = ()) -> None:
        """Finds the bodies that hinges and slides move, outwards from the base.

        Bodies with other kinds of joints, or below an excluded body, have no frame.

        Args:
            model: The model.
            base: Body whose frame name is given.
            base_frame: Frame name of the base.
            without: Bodies to exclude.
        """
        self._model = model
        left_out = set(without)
        root = int(model.body_weldid[base])
        seen_from = {root: (base_frame, _inverse(_chain(model, base, root)))}
        self.links: list[Link] = []
        for body in range(root + 1, model.nbody):  # parents come before their children
            parent = int(model.body_weldid[model.body_parentid[body]])
            if not model.body_jntnum[body] or parent not in seen_from or body in left_out:
                continue
            first = int(model.body_jntadr[body])
            joints = tuple(range(first, first + int(model.body_jntnum[body])))
            if any(int(model.jnt_type[joint]) not in (_HINGE, _SLIDE) for joint in joints):
                continue
            frame, offset = seen_from[parent]
            name = model.body(body).name or f"link_{body}"
            self.links.append(Link(body, frame, name, _joined(offset, _chain(model, body, parent)), joints))
            seen_from[body] = name, (np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]))
        self.joints = [joint for link in self.links for joint in link.joints]
        """Ids of the joints whose positions `poses` needs."""

    @property
    def frames(self) -> list[tuple[str, str]]:
        """Pairs of ROS frame names, for each link: its parent's, and its own."""
        return [(link.parent_frame, link.frame) for link in self.links]

    @property
    def frame_of(self) -> Mapping[int, str]:
        """ROS frame name of each body, by body number."""
        return {link.body: link.frame for link in self.links}

    def poses(self, positions: _Numbers) -> list[_Numbers]:
        """Computes each link's pose in its parent's frame: x, y, z, and a quaternion with w last.

        Args:
            positions: Positions of `joints`, a row per time.
        """
        found, column = [], 0
        for link in self.links:
            place, turn = link.start
            for joint in link.joints:
                moved = positions[:, column] - self._model.qpos0[self._model.jnt_qposadr[joint]]
                place, turn = self._moved(joint, place, turn, moved)
                column += 1
            rows = np.broadcast_to(place, (len(positions), 3)), np.broadcast_to(turn, (len(positions), 4))
            found.append(np.concatenate((rows[0], rows[1][:, _XYZW]), axis=1))
        return found

    def _moved(self, joint: int, place: _Numbers, turn: _Numbers, by: _Numbers) -> _Pose:
        axis = self._model.jnt_axis[joint][None]
        if int(self._model.jnt_type[joint]) == _SLIDE:
            return place + _turned(turn, axis) * by[:, None], turn
        anchor = self._model.jnt_pos[joint][None]
        half = by[:, None] / 2
        after = _product(turn, np.concatenate((np.cos(half), np.sin(half) * axis), axis=1))
        return place + _turned(turn, anchor) - _turned(after, anchor), after


def _chain(model: mujoco.MjModel, body: int, ancestor: int) -> _Pose:
    """Returns a body's pose in an ancestor's frame, with all joints in between in the model's reference position."""
    pose = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])
    while body != ancestor:
        pose = _joined((model.body_pos[body][None], model.body_quat[body][None]), pose)
        body = int(model.body_parentid[body])
    return pose


def _joined(outer: _Pose, inner: _Pose) -> _Pose:
    return outer[0] + _turned(outer[1], inner[0]), _product(outer[1], inner[1])


def _inverse(pose: _Pose) -> _Pose:
    back = pose[1] * (1, -1, -1, -1)
    return -_turned(back, pose[0]), back


def _product(first: _Numbers, second: _Numbers) -> _Numbers:
    w, x, y, z = first.T
    a, b, c, d = second.T
    return np.stack(
        (w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b,
         w * d + x * c - y * b + z * a), axis=1,
    )  # fmt: skip


def _turned(turn: _Numbers, vectors: _Numbers) -> _Numbers:
    """Returns vectors rotated by quaternions with w first, a row each."""
    across = 2.0 * np.cross(turn[:, 1:], vectors)
    return vectors + turn[:, :1] * across + np.cross(turn[:, 1:], across)
