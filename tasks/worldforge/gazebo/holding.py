"""Decides which movable bodies of an imported world are held fixed, and where the others come to rest."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from ...sdf.sdf_types import Pose
from ..proofs.guarantees import MAX_DRIFT_M, MAX_PENETRATION_M, REST_S
from ..proofs.overlaps import find_overlaps, meet, motion_of_bodies

_SETTLED_M = 0.05
"""Largest distance that a body may move until it rests, in metres; a body that moves further is held."""
_MOST_ROUNDS = 12

Build = Callable[[Collection[str], Mapping[str, Pose]], mujoco.MjModel]
"""Function that compiles the world with some bodies held, and others at given poses."""


@dataclass(slots=True)
class Rest:
    """Result of letting an imported world come to rest: which objects moved or are held."""

    held: dict[str, str] = field(default_factory=dict)
    """Reasons why bodies are held, by body name."""
    poses: dict[str, Pose] = field(default_factory=dict)
    """World poses of bodies that settled, by body name."""


def come_to_rest(build: Build) -> Rest:
    """Simulates an imported world until it settles, and fixes objects that overlap or do not come to rest.

    Args:
        build: Compiles the world.

    Returns:
        The bodies that have to be held, with reasons, and new poses of the others that moved.
    """
    rest = Rest()
    for overlapping, depth_m in _overlapping(build(rest.held, rest.poses)).items():
        rest.held[overlapping] = f"it overlaps something by {1e3 * depth_m:.0f} mm"
    for _ in range(_MOST_ROUNDS):
        model = build(rest.held, rest.poses)
        if model.njnt == 0:
            return rest
        moved_m, poses = motion_of_bodies(model, REST_S)
        gone = {name: way for name, way in moved_m.items() if not way <= _SETTLED_M}
        if gone:
            for name, way in gone.items():
                rest.held[name] = f"it moves {way:.2f} m by itself" if np.isfinite(way) else "it flies away"
                rest.poses.pop(name, None)
            continue
        if all(way < MAX_DRIFT_M for way in moved_m.values()):
            return rest
        rest.poses.update({name: Pose(*poses[name]) for name in moved_m if name in poses})
    for name in list(_overlapping(build(rest.held, rest.poses))):
        rest.held[name] = "it does not come to rest"
    # Bodies that creep for ever, such as a ball on a slope.
    model = build(rest.held, rest.poses)
    moved_m, _ = motion_of_bodies(model, REST_S)
    for name, way in moved_m.items():
        if not way < MAX_DRIFT_M:
            rest.held[name] = "it does not come to rest"
    return rest


def pieces_around_joints(model: mujoco.MjModel) -> set[str]:
    """Returns the names of the fixed objects that a jointed body overlaps, such as a door's frame.

    Args:
        model: The compiled world.
    """
    if model.njnt == 0:
        return set()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    jointed = {
        int(body)
        for body, kind in zip(model.jnt_bodyid, model.jnt_type, strict=True)
        if kind != mujoco.mjtJoint.mjJNT_FREE
    }
    found: set[str] = set()
    for overlap in find_overlaps(model, data):
        bodies: list[int] = model.geom_bodyid[[*overlap.geoms]].tolist()
        for body, other, part in zip(bodies, reversed(bodies), overlap.parts, strict=True):
            if body == 0 and other in jointed:
                found.add(part.partition(".")[0])
    return found


def _overlapping(model: mujoco.MjModel) -> dict[str, float]:
    """Returns the movable bodies that overlap another geom by more than 5 mm, with the depth in metres."""
    if model.njnt == 0:
        return {}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, float] = {}
    for overlap in find_overlaps(model, data):
        if overlap.depth_m <= MAX_PENETRATION_M:
            break
        bodies: list[int] = model.geom_bodyid[[*overlap.geoms]].tolist()
        for body in bodies:
            if model.body_weldid[body] and _meet(model, *overlap.geoms):
                name = model.body(body).name
                found[name] = max(found.get(name, 0.0), overlap.depth_m)
    return found


def _meet(model: mujoco.MjModel, one: int, other: int) -> bool:
    """Whether two geoms can collide with each other, by their contact bits and parents."""
    bodies: list[int] = model.geom_bodyid[[one, other]].tolist()
    near = {int(model.body_parentid[body]) for body in bodies}
    return meet(model, one, other) and not (near & {*bodies} - {0})
