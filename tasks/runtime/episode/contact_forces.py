"""Contact forces on the robot, by what touches it."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.runs.requirements import FLOOR_REACH_M
from .robot_body import robot_bodies

_MAX_QUIET = 1000
"""Lists of contacts without a touch of the robot that are remembered."""
_ROBOT, _FLOOR = 1, 100
_UPWARDS = 0.7
"""Cosine of the slope up to which a plane is ground."""


class ContactForces:
    """Reads the forces between a robot and anything but itself and the floor."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: NDArray[np.bool_],
        names: list[str],
        *,
        is_stale: bool = False,
    ) -> None:
        """Looks up who is who.

        Args:
            model: The compiled world with the robot.
            data: Its state, after `mj_forward`.
            robot: Which geoms are the robot's.
            names: What each geom is called.
            is_stale: Whether `data` stands between `mj_step1` and `mj_step2` when it is read, as dm_control's
                `legacy_step` leaves it: contacts have no forces then, and are solved again in a copy.
        """
        self._model, self._data = model, data
        # One number per geom, such that the two of a pair add up to `_ROBOT` for a touch of the robot only.
        self._codes = np.where(robot, _ROBOT, np.where(floor_geoms(model, data), _FLOOR, 0))
        self._names = names
        self._quiet: set[bytes] = set()
        self._wrench = np.zeros(6)
        self._copy = mujoco.MjData(model) if is_stale else None

    def read(self) -> dict[str, float]:
        """Returns the normal force in N of each thing that touches the robot now, by its name."""
        pairs = self._data.contact.geom
        signature = pairs.tobytes()
        # The same few lists of pairs come again and again: wheels and a slide on the floor, what lies on what.
        if signature in self._quiet:
            return {}
        touching = self._touching(pairs)
        if not touching.size:
            if len(self._quiet) < _MAX_QUIET:
                self._quiet.add(signature)
            return {}
        data = self._data
        if self._copy is not None:
            data = solved_copy(self._model, self._data, self._copy)
            pairs = data.contact.geom
            touching = self._touching(pairs)
        forces: dict[str, float] = {}
        for index in touching.tolist():
            first, second = pairs[index].tolist()
            other = self._names[second if self._codes[first] == _ROBOT else first]
            mujoco.mj_contactForce(self._model, data, index, self._wrench)
            forces[other] = forces.get(other, 0.0) + abs(float(self._wrench[0]))
        return forces

    def _touching(self, pairs: NDArray[np.int32]) -> NDArray[np.intp]:
        return np.flatnonzero(self._codes[pairs].sum(axis=1) == _ROBOT)


def solved_copy(model: mujoco.MjModel, data: mujoco.MjData, copy: mujoco.MjData) -> mujoco.MjData:
    """Returns `copy` in the state of `data`, with all forces solved; `data` itself stays as it is."""
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    mujoco.mj_setState(model, copy, state, kind)
    mujoco.mj_forward(model, copy)
    return copy


def floor_geoms(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.bool_]:
    """Returns a mask of the floor: fixed geoms up to 12 mm high, height fields, planes that look upwards.

    Args:
        model: The world.
        data: Its state, after `mj_forward`.
    """
    vertical = data.geom_xmat[:, 6:9]
    top = data.geom_xpos[:, 2] + np.einsum("ij,ij->i", vertical, model.geom_aabb[:, :3])
    top = top + np.einsum("ij,ij->i", np.abs(vertical), model.geom_aabb[:, 3:])
    plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    ground = np.where(plane, vertical[:, 2] > _UPWARDS, top <= FLOOR_REACH_M)
    ground |= model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD
    return ground & (model.body_weldid[model.geom_bodyid] == 0)


def robot_geoms(model: mujoco.MjModel, body: int) -> NDArray[np.bool_]:
    """Returns which geoms are the robot's, shape (ngeom,); see `robot_bodies`."""
    return robot_bodies(model, body)[model.geom_bodyid]


def can_touch(model: mujoco.MjModel, robot: NDArray[np.bool_]) -> bool:
    """Returns whether any geom of the robot could touch any other, by their collision bits.

    Args:
        model: The compiled world with the robot.
        robot: Which geoms are the robot's, shape (ngeom,).
    """
    kinds, affinities = model.geom_contype, model.geom_conaffinity
    own = {(int(kinds[geom]), int(affinities[geom])) for geom in np.flatnonzero(robot)}
    others = {(int(kinds[geom]), int(affinities[geom])) for geom in np.flatnonzero(~robot)}
    return any(kind & affinity or other & own_affinity for kind, own_affinity in own for other, affinity in others)


def geom_names(model: mujoco.MjModel, furniture_ids: Sequence[str] = ()) -> list[str]:
    """Returns the name of each geom for messages: a furniture id, `wall`, else its body or itself.

    Args:
        model: The compiled world.
        furniture_ids: Prefixes of geom names that name pieces of furniture.
    """
    ids = set(furniture_ids)
    return [_name(model, geom, ids) for geom in range(model.ngeom)]


def _name(model: mujoco.MjModel, geom_id: int, furniture_ids: set[str]) -> str:
    name = model.geom(geom_id).name
    # The longest prefix that is an id, up to a dot or a slash.
    for end in range(len(name), 0, -1):
        if (end == len(name) or name[end] in "./") and name[:end] in furniture_ids:
            return name[:end]
    if name.startswith("wall"):
        return "wall"
    body = int(model.geom_bodyid[geom_id])
    return (model.body(body).name or name or f"body {body}") if body else name or "unnamed"
