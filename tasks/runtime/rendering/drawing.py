"""Poses of everything that is drawn."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import mujoco


def awake(model: mujoco.MjModel) -> mujoco.MjModel:
    """Lets nothing sleep in a model, and returns it: what sleeps would not follow its `qpos`."""
    model.opt.enableflags &= ~mujoco.mjtEnableBit.mjENBL_SLEEP.value
    return model


def work_out_places(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Brings all places up to date with `qpos`, without collisions and forces."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    mujoco.mj_flex(model, data)
    mujoco.mj_tendon(model, data)
