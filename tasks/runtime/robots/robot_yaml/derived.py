"""Derives a `robot.yaml` from a model that comes without one, if its base moves freely and has actuators."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pydantic import ValidationError

from .....schemas.wire.request_problems import problems_of
from .mapping import MAPPING_FILE, invalid
from .shape import RobotModel, robot_model_type

_LIDAR_ABOVE_M = 0.02
"""Height in metres of the lidar over the robot's highest part, so that it does not see the robot itself."""
_ROUNDED_M = 0.01
"""Step in metres to which sizes are rounded up."""


def derive_mapping(path: Path) -> RobotModel | str:
    """Derives a robot's `robot.yaml` from its model: initial pose, footprint, and actuators as drive.

    Args:
        path: Path of the MJCF model.

    Returns:
        The mapping, or in words why the model does not say enough.

    Raises:
        LaunchError: MuJoCo cannot read the model.
    """
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as cause:
        raise invalid(path, f"MuJoCo cannot read it: {' '.join(str(cause).split())}") from cause
    base = int(model.jnt_bodyid[0]) if model.njnt else 0
    if (lacks := _lacks(model, base)) is not None:
        return lacks
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    name, height_m = model.body(base).name, round(float(data.xpos[base][2]), 4)
    radius_m, top_m = _extent(model, data, base)
    if radius_m <= 0:
        return "it has no shape that collides with anything, so its size is not known"
    if height_m < 0:
        return f"its first body, {name!r}, is {-height_m:g} m below the floor, so the model does not say how it stands"
    document = {
        "version": 1,
        "model": path.name,
        "base": name,
        "footprint": {"radius_m": radius_m},
        "spawn": {"height_m": height_m, **_start(model, data)},
        "drive": {"kind": "actuators"},
        "sensors": {"lidar": {"height_m": round(top_m + _LIDAR_ABOVE_M, 4)}},
    }
    kind = robot_model_type(document)
    try:
        return kind.model_validate(document)
    except ValidationError as error:
        return "; ".join(map(str, problems_of(error, kind)))


def _lacks(model: mujoco.MjModel, base: int) -> str | None:
    """Returns the part that a model lacks for a derived `robot.yaml`, as text; None: it has all."""
    if not model.njnt or int(model.jnt_type[0]) != int(mujoco.mjtJoint.mjJNT_FREE):
        name = model.body(1).name if model.nbody > 1 else "none"
        return f"its first body, {name!r}, has no free joint, so the model does not say how the robot moves about"
    if not model.body(base).name:
        return "its first body has no name, by which a mapping could say that it is the base"
    return None if model.nu else "it has no actuators, so that nothing drives it"


def _start(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, Any]:
    """Returns the spawn entry for `robot.yaml`: the first keyframe by name, or its joint positions if it has none.

    The entry is empty if the model has no keyframe.
    """
    if not model.nkey:
        return {}
    if keyframe := model.key(0).name:
        return {"keyframe": keyframe}
    joints = [model.joint(index) for index in range(model.njnt)]
    single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    named = [joint for joint in joints if joint.name and int(joint.type[0]) in map(int, single)]
    return {"joints": {joint.name: float(data.qpos[joint.qposadr[0]]) for joint in named}}


def said_of(mapping: RobotModel) -> str:
    """Describes a derived `robot.yaml` in one log line: base, sizes and actuators."""
    return (
        f"there is no {MAPPING_FILE}: the base is {mapping.base!r}, {mapping.spawn.height_m:g} m over the floor, "
        f"{mapping.footprint.radius_m:g} m around, and its actuators are the action; write one for anything else"
    )


def _extent(model: mujoco.MjModel, data: mujoco.MjData, base: int) -> tuple[float, float]:
    """Returns the radius around the base and the greatest height of all geoms that collide, in metres."""
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    collides &= model.body_rootid[model.geom_bodyid] == base
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    radius_m = top_m = 0.0
    for geom in np.flatnonzero(collides):
        centre, half = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
        points = (centre + corners * half) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        away = np.hypot(*(points[:, :2] - data.xpos[base][:2]).T)
        radius_m, top_m = max(radius_m, float(away.max())), max(top_m, float(points[:, 2].max()))
    return math.ceil(radius_m / _ROUNDED_M - 1e-9) * _ROUNDED_M, top_m
