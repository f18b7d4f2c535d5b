"""Access to an application's physics: dm_control's, or any object with a model and its data."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from typing import Any

import mujoco


def raw_physics(physics: Any) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Returns MuJoCo's own model and data behind a dm_control physics, or behind an object that has them."""
    return getattr(physics.model, "ptr", physics.model), getattr(physics.data, "ptr", physics.data)
