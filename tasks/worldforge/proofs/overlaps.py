"""Overlaps of solid parts (also fixed ones), and how far loose objects move before they rest."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import StabilityChecks

_LEAST_M = 1e-4
"""Depth of an overlap below which bodies only touch, in metres."""


class Overlap(NamedTuple):
    """Two solid parts of a world that overlap, and how deep."""

    depth_m: float
    """Distance by which one of the parts would have to be moved to separate them, in metres."""
    parts: tuple[str, str]
    """Names of two overlapping geoms; empty for geoms without name."""
    geoms: tuple[int, int]
    """Ids of two overlapping geoms."""


def find_overlaps(model: mujoco.MjModel, data: mujoco.MjData) -> list[Overlap]:
    """Finds all solid parts of different objects that overlap, deepest first.

    A piece is a body, a piece of furniture, or the whole building: its own parts are built into each other.

    Args:
        model: A world.
        data: MuJoCo state of the world, after `mj_kinematics`.
    """
    solid = (model.geom_contype | model.geom_conaffinity != 0) & (model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE))
    geoms = np.flatnonzero(solid)
    found: list[Overlap] = []
    for one, other in geoms[_near(model, data, geoms)].tolist():
        depth_m = -mujoco.mj_geomDistance(model, data, one, other, 0.0, None)
        if depth_m > _LEAST_M:
            found.append(Overlap(depth_m, (_name(model, one), _name(model, other)), (one, other)))
    return sorted(found, reverse=True)


def meet(model: mujoco.MjModel, one: int, other: int) -> bool:
    """Returns whether the bits of two geoms let them collide.

    Args:
        model: A world.
        one: Number of a geom.
        other: Number of another.
    """
    types, affinities = model.geom_contype, model.geom_conaffinity
    return bool((types[one] & affinities[other]) | (types[other] & affinities[one]))


def _near(model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.intp]) -> NDArray[np.intp]:
    """Returns pairs of indices in `geoms` whose bounding boxes overlap, in a tenth of a millisecond.

    Parts of one piece do not make a pair. The result has shape (n, 2).
    """
    axes, boxes = data.geom_xmat[geoms].reshape(-1, 3, 3), model.geom_aabb[geoms]
    center = data.geom_xpos[geoms] + (axes @ boxes[:, :3, None])[..., 0]
    half = (np.abs(axes) @ boxes[:, 3:, None])[..., 0]
    low, high = center - half + _LEAST_M, center + half
    pieces = _pieces(model, geoms)
    near = pieces[:, None] < pieces
    for axis in range(3):
        reaches = low[:, None, axis] < high[None, :, axis]
        near &= reaches & reaches.T
    return np.argwhere(near)


def _pieces(model: mujoco.MjModel, geoms: NDArray[np.intp]) -> NDArray[np.intp]:
    """Returns the number of the piece that each geom is part of."""
    numbers: dict[tuple[int, str], int] = {}
    found: list[int] = []
    for geom, body in zip(geoms.tolist(), model.geom_bodyid[geoms].tolist(), strict=True):
        piece, dot, _ = _name(model, geom).partition(".")
        # What has no dot in its name is the building's.
        key = (body, piece if dot and body == 0 else "")
        found.append(numbers.setdefault(key, len(numbers)))
    return np.array(found, dtype=np.intp)


def _name(model: mujoco.MjModel, geom: int) -> str:
    """Returns a geom's name from the model's buffer of names; `model.geom(id).name` is twenty times slower."""
    begin = model.name_geomadr[geom]
    return model.names[begin : model.names.index(b"\0", begin)].decode()


PUSHES = 8
PUSHED_S = 30.0
PUSH_MPS = 0.05
"""Typical speed of a test push, in m/s; two thirds of pushes along an axis are weaker."""

THROWN_M = 1e6
"""Distance reported for a body that flew away, in metres: finite, as JSON has no infinity."""

_WATCHED_S = 0.2
"""Time at the beginning during which no body may fall asleep, in seconds.

So bodies that tip over slowly have begun to. A body balanced on an edge to the micrometre has after 0.1 s, as contacts
are soft. Steps with bodies awake take most of the time.
"""

_WATCHED_AFTER_PUSH_S = 0.5
"""Time after a push during which no body may fall asleep, in seconds.

It is longer, as rocking bodies are slow where they turn back.
"""

_SLEEP_TOLERANCE = 5e-4
"""Speed below which bodies may fall asleep after that time (MuJoCo's sleep tolerance).

Cylinders on tables tremble at a third of it for ever. In the rest of two seconds a body that slow moves less than a
millimetre.
"""

_STEPS_PER_CHECK = 25
"""Number of steps after which it is checked whether any body is awake: most motion is over in twice as many."""

_DOFS = 6
_PUSH_SPEED_FACTORS = np.array([1.0, 1.0, 0.5, 5.0, 5.0, 5.0])
"""Factors of the push speed per degree of freedom: x, y and z in m/s, then rotations in rad/s."""


def drift_m(model: mujoco.MjModel, settle_s: float) -> NDArray[np.float64]:
    """Simulates a world; returns how far each movable body moves by itself, in metres.

    There is one entry for each joint. A body that was so fast that MuJoCo gave up has `THROWN_M`.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies = np.asarray(model.jnt_bodyid)
    before = data.xipos[bodies].copy()
    _settle(model, data, settle_s, _WATCHED_S)
    way = np.linalg.norm(data.xipos[bodies] - before, axis=1)
    way[bodies == _thrown(model, data)] = THROWN_M
    return way


def _thrown(model: mujoco.MjModel, data: mujoco.MjData) -> int:
    """Returns the body that was so fast that MuJoCo reset the simulation, which makes distances invalid; -1: none."""
    for kind, joints in (
        (mujoco.mjtWarning.mjWARN_BADQPOS, model.jnt_qposadr),
        (mujoco.mjtWarning.mjWARN_BADQVEL, model.jnt_dofadr),
        (mujoco.mjtWarning.mjWARN_BADQACC, model.jnt_dofadr),
    ):
        if data.warning[kind].number:
            joint = int(np.searchsorted(joints, data.warning[kind].lastinfo, side="right")) - 1
            return int(model.jnt_bodyid[joint])
    return -1


def motion_of_bodies(
    model: mujoco.MjModel, settle_s: float
) -> tuple[dict[str, float], dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]]:
    """Simulates a world, and returns how far each jointed body moved.

    Args:
        model: A world.
        settle_s: Simulated seconds.

    Returns:
        The way of each body's middle in metres, by its name, and position and rotation of those that move freely.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies = sorted({int(body) for body in model.jnt_bodyid})
    before = data.xipos[bodies].copy()
    _settle(model, data, settle_s, _WATCHED_S)
    way = np.linalg.norm(data.xipos[bodies] - before, axis=1)
    if (thrown := _thrown(model, data)) >= 0:
        way[bodies.index(thrown)] = np.inf
    free = {int(model.jnt_bodyid[joint]) for joint in np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))}
    names = [model.body(body).name for body in bodies]
    poses = {
        name: (data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy())
        for name, body in zip(names, bodies, strict=True)
        if body in free
    }
    return dict(zip(names, way.tolist(), strict=True)), poses


def measure_stability(model: mujoco.MjModel, seed: int) -> StabilityChecks:
    """Pushes all loose objects slightly, several times, and measures where they come to rest.

    Args:
        model: A world.
        seed: Random seed of the pushes.
    """
    dice = np.random.default_rng(seed)
    free = np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))
    bodies, dofs = model.jnt_bodyid[free], model.jnt_dofadr[free][:, None] + np.arange(_DOFS)
    # A ball rolls away, as balls do; it only must not fall.
    stays = model.geom_type[model.body_geomadr[bodies]] != mujoco.mjtGeom.mjGEOM_SPHERE
    moved, sunk = np.zeros(len(free)), np.zeros(len(free))
    for _ in range(PUSHES):
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        before = data.xipos[bodies].copy()
        data.qvel[dofs] = PUSH_MPS * _PUSH_SPEED_FACTORS * dice.standard_normal(dofs.shape)
        _settle(model, data, PUSHED_S, _WATCHED_AFTER_PUSH_S)
        way = data.xipos[bodies] - before
        moved, sunk = np.maximum(moved, stays * np.linalg.norm(way, axis=1)), np.maximum(sunk, -way[:, 2])
    return StabilityChecks(
        pushes=PUSHES,
        pushed_s=PUSHED_S,
        push_mps=PUSH_MPS,
        max_moved_m=round(float(moved.max(initial=0.0)), 6),
        max_sunk_m=round(float(sunk.max(initial=0.0)), 6),
        furthest=model.body(int(bodies[np.argmax(np.maximum(moved, sunk))])).name if len(free) else None,
    )


def _settle(model: mujoco.MjModel, data: mujoco.MjData, span_s: float, watched_s: float) -> None:
    """Simulates with every body awake at first; bodies at rest fall asleep later, which saves time.

    Bodies that are asleep from the beginning would have no contacts and never move: a floating or half-sunk book would
    pass. `data` is advanced by `span_s` seconds, or less if all bodies fall asleep; none does in the first `watched_s`.
    """
    watched_s = min(watched_s, span_s)
    awake = model.opt.enableflags
    mujoco.mj_step(model, data, nstep=round(watched_s / model.opt.timestep))
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    model.opt.sleep_tolerance = _SLEEP_TOLERANCE
    model.tree_sleep_policy[:] = int(mujoco.mjtSleepPolicy.mjSLEEP_AUTO_ALLOWED)
    for left in range(round((span_s - watched_s) / model.opt.timestep), 0, -_STEPS_PER_CHECK):
        mujoco.mj_step(model, data, nstep=min(left, _STEPS_PER_CHECK))
        if data.ntree_awake == 0:
            break  # nothing is left that could wake anything
    model.opt.enableflags = awake
    mujoco.mj_kinematics(model, data)
