"""Finds the robot's bodies in a model."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import mujoco
import numpy as np
from numpy.typing import NDArray

_LEAST_RADIUS_M = 0.05


def robot_body(model: mujoco.MjModel) -> int | None:
    """Returns the root body of what most actuators move.

    Without actuators it is the first thing that has joints; None when nothing can move.
    """
    if roots := acting_roots(model):
        return int(np.bincount(roots).argmax())
    if model.njnt:
        return int(model.body_rootid[model.jnt_bodyid[0]])
    return None


def acting_roots(model: mujoco.MjModel) -> list[int]:
    """Returns the root body of what each actuator moves, in the actuators' order; the world is none."""
    moved = (_moved_body(model, actuator) for actuator in range(model.nu))
    return [int(model.body_rootid[body]) for body in moved if body > 0]


def robot_bodies(model: mujoco.MjModel, body: int) -> NDArray[np.bool_]:
    """Returns which bodies are the robot's: all that moves with a body, shape (nbody,).

    What the robot stands in but is fixed to the world, such as a room's body that holds robot and furniture, is not.

    Args:
        model: The compiled world with the robot.
        body: Any body of the robot.
    """
    top = body
    while (parent := int(model.body_parentid[top])) and model.body_weldid[parent]:
        top = parent
    return bodies_below(model, top)


def bodies_below(model: mujoco.MjModel, body: int) -> NDArray[np.bool_]:
    """Return whether each body is this one or hangs on it."""
    below = np.zeros(model.nbody, dtype=np.bool_)
    below[body] = True
    for each in range(body + 1, model.nbody):  # parents come before their children
        below[each] = below[model.body_parentid[each]]
    return below


def radius_of(model: mujoco.MjModel, body: int) -> float:
    """Returns the radius in m of a ball around the body's reference position that holds it and what hangs on it.

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
    """The body that an actuator acts on; 0, the world, when that cannot be said."""
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
