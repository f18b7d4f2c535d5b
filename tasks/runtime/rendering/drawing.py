"""Poses of everything that is drawn."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import mujoco


def awake(model: mujoco.MjModel) -> mujoco.MjModel:
    """Switches sleep off in a model, and returns it: sleeping bodies would not follow their `qpos`."""
    model.opt.enableflags &= ~mujoco.mjtEnableBit.mjENBL_SLEEP.value
    return model


def work_out_places(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Updates all poses from `qpos`, without collisions and forces."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    mujoco.mj_flex(model, data)
    mujoco.mj_tendon(model, data)
