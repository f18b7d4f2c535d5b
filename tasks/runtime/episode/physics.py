"""Reads MuJoCo's physics: the robot's body, its contact forces, and its clearance."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray


def raw_physics(physics: Any) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Returns MuJoCo's model and data inside a dm_control physics."""
    return getattr(physics.model, "ptr", physics.model), getattr(physics.data, "ptr", physics.data)


_LEAST_RADIUS_M = 0.05


def robot_body(model: mujoco.MjModel) -> int | None:
    """Returns the number of the robot's root body: the one that most actuators move.

    Without actuators it is the first body with joints; None if no body can move.
    """
    if roots := acting_roots(model):
        return int(np.bincount(roots).argmax())
    if model.njnt:
        return int(model.body_rootid[model.jnt_bodyid[0]])
    return None


def acting_roots(model: mujoco.MjModel) -> list[int]:
    """Returns for each actuator the root body of the kinematic tree that it moves, without the world body."""
    moved = (_moved_body(model, actuator) for actuator in range(model.nu))
    return [int(model.body_rootid[body]) for body in moved if body > 0]


def acting_body(model: mujoco.MjModel) -> int | None:
    """Returns the number of the body that is taken for the robot: the first free body with actuators.

    Else it is the first body with actuators, else the only free body; None if there is none of these.
    """
    roots = list(dict.fromkeys(acting_roots(model)))
    free = [int(body) for body in model.jnt_bodyid[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)]]
    for choice in ([root for root in free if root in roots], roots, free if len(free) == 1 else []):
        if choice:
            return choice[0]
    return None


def actuators_of(model: mujoco.MjModel, bodies: NDArray[np.bool_]) -> list[int]:
    """Returns the numbers of the actuators that move any of some bodies, given as a mask of shape (nbody,)."""
    return [actuator for actuator in range(model.nu) if bodies[_moved_body(model, actuator)]]


def robot_bodies(model: mujoco.MjModel, body: int) -> NDArray[np.bool_]:
    """Returns a mask of the bodies that belong to the robot, shape (nbody,).

    A fixed ancestor, such as a room's body that holds robot and furniture, does not belong to the robot.

    Args:
        model: The compiled world with the robot.
        body: Any body of the robot.
    """
    top = body
    while (parent := int(model.body_parentid[top])) and model.body_weldid[parent]:
        top = parent
    return bodies_below(model, top)


def bodies_below(model: mujoco.MjModel, body: int) -> NDArray[np.bool_]:
    """Returns a mask, shape (nbody,), of a body and all its descendants."""
    below = np.zeros(model.nbody, dtype=np.bool_)
    below[body] = True
    for each in range(body + 1, model.nbody):  # parents come before their children
        below[each] = below[model.body_parentid[each]]
    return below


def radius_of(model: mujoco.MjModel, body: int) -> float:
    """Returns the radius in metres of a sphere around a body that contains it and its descendants at rest.

    Of what hangs on it, the pose at rest counts.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == body)
    if not len(geoms):
        return _LEAST_RADIUS_M
    away = np.linalg.norm(data.geom_xpos[geoms] - data.xpos[body], axis=1) + model.geom_rbound[geoms]
    return max(_LEAST_RADIUS_M, float(away.max()))


def _moved_body(model: mujoco.MjModel, actuator: int) -> int:
    """Returns the id of the body that an actuator acts on; 0 (the world) if it cannot be determined."""
    # As a plain number: an enumeration's member is not equal to one of numpy.
    kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        return int(model.jnt_bodyid[target])
    if kind in (mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK):
        return int(model.site_bodyid[target])
    if kind == mujoco.mjtTrn.mjTRN_BODY:
        return target
    if kind == mujoco.mjtTrn.mjTRN_TENDON and model.tendon_num[target]:
        first = int(model.tendon_adr[target])
        wrapped = int(model.wrap_objid[first])
        is_joint = int(model.wrap_type[first]) == mujoco.mjtWrap.mjWRAP_JOINT
        return int(model.jnt_bodyid[wrapped] if is_joint else model.site_bodyid[wrapped])
    return 0


_FAR_M = 1e6


class ClearanceMeter:
    """Measures the smallest distance between the robot's surface and other objects.

    `mj_geomDistance` measures pairs of geoms exactly. Few pairs are measured: the other geoms are taken in the order of
    the distance of their bounding boxes from a sphere around the robot, until no other can be nearer.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: NDArray[np.bool_],
        others: NDArray[np.bool_],
        names: Sequence[str],
    ) -> None:
        """Prepares to measure the distance between a robot and other objects.

        Args:
            model: The compiled world with the robot.
            data: State of the model, after `mj_forward`.
            robot: Mask of the robot's geoms.
            others: Mask of the geoms to measure the distance to.
            names: Name of each geom, for messages.
        """
        self._model, self._data, self._names = model, data, names
        solid = _collides(model, robot)
        others = others & solid
        # A robot whose geoms touch nothing at all is measured by what can be seen of it.
        body = robot & _collides(model, others) if others.any() else robot
        self._robot = np.flatnonzero(body if body.any() else robot)
        self._others = np.flatnonzero(others)
        self._centre, self._half = model.geom_aabb[self._others, :3], model.geom_aabb[self._others, 3:]
        self._radii = model.geom_rbound[self._robot]

    @property
    def has_others(self) -> bool:
        """Whether there are other objects to measure the distance to."""
        return self._others.size > 0 and self._robot.size > 0

    def measure(self, below_m: float = _FAR_M) -> tuple[float, str] | None:
        """Measures the smallest distance in metres (negative for an overlap), and the name of the nearest object.

        Args:
            below_m: Distances above this are not measured; a smaller value is faster.

        Returns:
            None when nothing is nearer than `below_m`.
        """
        if not self.has_others:
            return None
        model, data, robot = self._model, self._data, self._robot.tolist()
        bounds = self._lower_bounds()
        nearest, other = min(below_m, _FAR_M), -1
        candidates = np.flatnonzero(bounds < nearest)
        for index in candidates[np.argsort(bounds[candidates])].tolist():
            if bounds[index] >= nearest:
                break
            geom = int(self._others[index])
            for part in robot:
                distance = mujoco.mj_geomDistance(model, data, part, geom, nearest, None)
                if distance < nearest:
                    nearest, other = distance, geom
        return None if other < 0 else (nearest, self._names[other])

    def _lower_bounds(self) -> NDArray[np.float64]:
        """Returns lower bounds, in metres, for the distance of each other geom from the robot, shape (geoms,).

        They are computed from spheres and bounding boxes, and are -inf for geoms that may penetrate the robot.
        """
        positions = self._data.geom_xpos[self._robot]
        middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
        radius = float((np.linalg.norm(positions - middle, axis=1) + self._radii).max())
        away = middle - self._data.geom_xpos[self._others]
        axes = self._data.geom_xmat[self._others].reshape(-1, 3, 3)
        local = np.einsum("nij,ni->nj", axes, away) - self._centre
        gap = np.maximum(np.abs(local) - self._half, 0.0)
        # Penetrating geoms have no bound: the deepest is to be found.
        distance = np.sqrt(np.einsum("nj,nj->n", gap, gap)) - radius
        return np.where(distance <= 0, -np.inf, distance)


def _collides(model: mujoco.MjModel, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns a mask of the geoms that can collide with one of the given geoms; purely visual geoms cannot."""
    kinds = int(np.bitwise_or.reduce(model.geom_contype[some], initial=0))
    partners = int(np.bitwise_or.reduce(model.geom_conaffinity[some], initial=0))
    return (model.geom_contype & partners != 0) | (model.geom_conaffinity & kinds != 0)


_FLOOR_REACH_M = 0.012
"""Height in metres up to which a fixed geom counts as floor: ground, rugs, thresholds."""
_MAX_QUIET = 1000
"""Maximum number of remembered contact lists in which the robot touches nothing."""
_ROBOT, _FLOOR = 1, 100
_UPWARDS = 0.7
"""Cosine of the slope up to which a plane counts as ground."""


class ContactForces:
    """Reads the contact forces between a robot and all objects except the floor."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: NDArray[np.bool_],
        names: list[str],
        *,
        is_stale: bool = False,
    ) -> None:
        """Determines the geoms of the robot and of other objects, whose contact forces are read later.

        Args:
            model: The compiled world with the robot.
            data: State of the model, after `mj_forward`.
            robot: Mask of the robot's geoms.
            names: Name of each geom, for messages.
            is_stale: Whether `data` is between `mj_step1` and `mj_step2` when it is read, as dm_control's `legacy_step`
                leaves it: contacts have no forces then, and are solved again in a copy.
        """
        self._model, self._data = model, data
        # One number per geom, such that the two of a pair add up to `_ROBOT` for a touch of the robot only.
        self._codes = np.where(robot, _ROBOT, np.where(floor_geoms(model, data), _FLOOR, 0))
        self._names = names
        self._quiet: set[bytes] = set()
        self._wrench = np.zeros(6)
        self._copy = mujoco.MjData(model) if is_stale else None

    def read(self) -> dict[str, float]:
        """Returns the normal forces in newtons of the objects that touch the robot now, by name; may be empty."""
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
    """Copies a MuJoCo state into `copy`, solves all forces there, and returns it; the original is unchanged."""
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    mujoco.mj_setState(model, copy, state, kind)
    mujoco.mj_forward(model, copy)
    return copy


def floor_geoms(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.bool_]:
    """Returns a mask of the geoms that are floor (low fixed geoms, height fields, planes).

    Args:
        model: Compiled world.
        data: State of the world, after `mj_forward`.
    """
    vertical = data.geom_xmat[:, 6:9]
    top = data.geom_xpos[:, 2] + np.einsum("ij,ij->i", vertical, model.geom_aabb[:, :3])
    top = top + np.einsum("ij,ij->i", np.abs(vertical), model.geom_aabb[:, 3:])
    plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    ground = np.where(plane, vertical[:, 2] > _UPWARDS, top <= _FLOOR_REACH_M)
    ground |= model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD
    return ground & (model.body_weldid[model.geom_bodyid] == 0)


def robot_geoms(model: mujoco.MjModel, body: int) -> NDArray[np.bool_]:
    """Returns a mask of the robot's geoms, shape (ngeom,); see `robot_bodies`."""
    return robot_bodies(model, body)[model.geom_bodyid]


def can_touch(model: mujoco.MjModel, robot: NDArray[np.bool_]) -> bool:
    """Whether any geom of the robot can collide with other geoms.

    Args:
        model: The compiled world with the robot.
        robot: Mask of the robot's geoms, shape (ngeom,).
    """
    kinds, affinities = model.geom_contype, model.geom_conaffinity
    own = {(int(kinds[geom]), int(affinities[geom])) for geom in np.flatnonzero(robot)}
    others = {(int(kinds[geom]), int(affinities[geom])) for geom in np.flatnonzero(~robot)}
    return any(kind & affinity or other & own_affinity for kind, own_affinity in own for other, affinity in others)


def geom_names(model: mujoco.MjModel, furniture_ids: Sequence[str] = ()) -> list[str]:
    """Returns a name for each geom for messages: a furniture id, `wall`, its body's name or its own.

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
