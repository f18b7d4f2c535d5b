"""Settling: how far things that can move go by themselves, and after small pushes."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.checks import StabilityChecks

PUSHES = 8
PUSHED_S = 30.0
PUSH_MPS = 0.05
"""Typical speed of a push; two thirds of pushes along an axis are weaker."""

_WATCHED_S = 0.2
"""Seconds at the begin in which nothing falls asleep, so that what tips over slowly has begun to. What is balanced on
an edge to the micrometre has after 0.1 s, as contacts are soft. Steps awake are most of settling."""

_WATCHED_AFTER_PUSH_S = 0.5
"""Longer, as what rocks is slow where it turns back."""

_SLEEP_TOLERANCE = 5e-4
"""From then on, what is slower than this may fall asleep: cylinders on tables tremble at a third of it for ever. In the
rest of two seconds a body that slow moves less than a millimetre."""

_STRIDE = 25
"""Steps after which it is seen whether anything is awake: most of what loose objects do is over in twice as many."""

_DOFS = 6
_SHARES = np.array([1.0, 1.0, 0.5, 5.0, 5.0, 5.0])
"""Factors of a push's speed per degree of freedom: x and y, upwards half as fast, then turns in radians a second."""


def drift_m(model: mujoco.MjModel, settle_s: float) -> NDArray[np.float64]:
    """How far the middle of each body that can move goes by itself."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies = np.asarray(model.jnt_bodyid)
    before = data.xipos[bodies].copy()
    _settle(model, data, settle_s, _WATCHED_S)
    return np.linalg.norm(data.xipos[bodies] - before, axis=1)


def measure_stability(model: mujoco.MjModel, seed: int) -> StabilityChecks:
    """Pushes all loose objects a little, several times, and watches each time where they come to rest.

    Args:
        model: a world.
        seed: of the pushes.
    """
    dice = np.random.default_rng(seed)
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    bodies, dofs = model.jnt_bodyid[free], model.jnt_dofadr[free][:, None] + np.arange(_DOFS)
    # A ball rolls away, as balls do; it only must not fall.
    stays = model.geom_type[model.body_geomadr[bodies]] != mujoco.mjtGeom.mjGEOM_SPHERE
    moved, sunk = np.zeros(len(free)), np.zeros(len(free))
    for _ in range(PUSHES):
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        before = data.xipos[bodies].copy()
        data.qvel[dofs] = PUSH_MPS * _SHARES * dice.standard_normal(dofs.shape)
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
    """Lets physics run with every body awake at first; what has come to rest falls asleep later, which saves time.

    Asleep from the begin, bodies would have no contacts and never move: a floating or half-sunk book would pass.
    """
    watched_s = min(watched_s, span_s)
    awake = model.opt.enableflags
    mujoco.mj_step(model, data, nstep=round(watched_s / model.opt.timestep))
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    model.opt.sleep_tolerance = _SLEEP_TOLERANCE
    model.tree_sleep_policy[:] = int(mujoco.mjtSleepPolicy.mjSLEEP_AUTO_ALLOWED)
    for left in range(round((span_s - watched_s) / model.opt.timestep), 0, -_STRIDE):
        mujoco.mj_step(model, data, nstep=min(left, _STRIDE))
        if data.ntree_awake == 0:
            break  # nothing is left that could wake anything
    model.opt.enableflags = awake
    mujoco.mj_kinematics(model, data)
