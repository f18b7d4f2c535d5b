"""URDF of a robot in a compiled model, for `/robot_description`: links, joints, and visual shapes."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from .messages import TransformStamped

_GEOM, _JOINT = mujoco.mjtGeom, mujoco.mjtJoint
_HINGE, _SLIDE = int(_JOINT.mjJNT_HINGE), int(_JOINT.mjJNT_SLIDE)
_SHOWN_GROUPS = 3
"""Number of geom groups that MuJoCo draws by default: 0, 1, 2."""
_Array = NDArray[np.float64]


def robot_description(
    name: str,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    base: int,
    frames: Mapping[int, str],
    joints: Mapping[int, str],
    mounts: Iterable[TransformStamped],
) -> str:
    """Makes a URDF description of a simulated robot, for RViz and `robot_state_publisher`.

    Meshes become their bounding boxes. Bodies that one hinge or slide through their origin moves become links with
    joints; other moving bodies are fixed at their present pose.

    Args:
        name: Name of the robot.
        model: The compiled world with the robot.
        data: A state, after `mj_forward`.
        base: Body whose frame is the base.
        frames: Link names by body number, including the base; other links have the names of the model.
        joints: Joint names by joint number, as in `/joint_states`.
        mounts: Fixed frames of sensors on links.
    """
    robot = ET.Element("robot", name=name)
    base = int(model.body_weldid[base])
    roots = _link_roots(model, base)
    named = {root: frames.get(root) or _own_name(model, root) for root in roots}
    named[base] = next(frame for body, frame in frames.items() if int(model.body_weldid[body]) == base)
    for root in roots:
        link = ET.SubElement(robot, "link", name=named[root])
        for geom in np.flatnonzero(model.body_weldid[model.geom_bodyid] == root).tolist():
            if model.geom_group[geom] < _SHOWN_GROUPS:
                _add_shape(link, model, data, geom, root)
    for root in roots:
        if root != base:
            parent = int(model.body_weldid[model.body_parentid[root]])
            _add_joint(robot, model, data, parent, root, named, joints)
    for mount in mounts:
        if (parent := mount.header.frame_id) in named.values():
            ET.SubElement(robot, "link", name=mount.child_frame_id)
            place, turn = mount.transform
            quaternion = np.array((turn.w, turn.x, turn.y, turn.z))
            _connect(robot, f"{mount.child_frame_id}_joint", "fixed", parent, mount.child_frame_id)
            _add_origin(robot[-1], np.array(place), _matrix(quaternion))
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


def _link_roots(model: mujoco.MjModel, base: int) -> list[int]:
    """Returns the base and all bodies below it that move relative to their parents; parents come first."""
    below = {base}
    for body in range(base + 1, model.nbody):
        if int(model.body_weldid[model.body_parentid[body]]) in below and int(model.body_weldid[body]) == body:
            below.add(body)
    return sorted(below)


def _own_name(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name.rpartition("/")[2] or f"link_{body}"


def _add_shape(link: ET.Element, model: mujoco.MjModel, data: mujoco.MjData, geom: int, root: int) -> None:
    size, kind = model.geom_size[geom].tolist(), int(model.geom_type[geom])
    red, green, blue, alpha = model.geom_rgba[geom].tolist()
    if alpha == 0.0:
        return
    visual = ET.SubElement(link, "visual")
    place, turn = _seen_from(data, root, data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3))
    match kind:
        case _GEOM.mjGEOM_SPHERE:
            shape, members = "sphere", {"radius": size[0]}
        case _GEOM.mjGEOM_CYLINDER | _GEOM.mjGEOM_CAPSULE:
            round_ends = 2 * size[0] if kind == _GEOM.mjGEOM_CAPSULE else 0.0
            shape, members = "cylinder", {"radius": size[0], "length": 2 * size[1] + round_ends}
        case _GEOM.mjGEOM_BOX:
            shape, members = "box", {"size": [2 * side for side in size]}
        case _:
            middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
            place = place + turn @ middle
            shape, members = "box", {"size": (2 * half).tolist()}
    _add_origin(visual, place, turn)
    attributes = {key: _numbers(value) for key, value in members.items()}
    ET.SubElement(ET.SubElement(visual, "geometry"), shape, attributes)
    material = ET.SubElement(visual, "material", name=f"colour_{geom}")
    ET.SubElement(material, "color", rgba=_numbers((red, green, blue, alpha)))


def _add_joint(
    robot: ET.Element,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    parent: int,
    child: int,
    named: Mapping[int, str],
    joints: Mapping[int, str],
) -> None:
    first, count = int(model.body_jntadr[child]), int(model.body_jntnum[child])
    kind = int(model.jnt_type[first])
    moves = count == 1 and kind in (_HINGE, _SLIDE) and not model.jnt_pos[first].any()
    if not moves:
        _connect(robot, f"{named[child]}_joint", "fixed", named[parent], named[child])
        _add_origin(robot[-1], *_seen_from(data, parent, data.xpos[child], data.xmat[child].reshape(3, 3)))
        return
    limited = bool(model.jnt_limited[first])
    motion = "prismatic" if kind == _SLIDE else "revolute" if limited else "continuous"
    name = joints.get(first) or model.joint(first).name.rpartition("/")[2] or f"joint_{first}"
    _connect(robot, name, motion, named[parent], named[child])
    # Where the child is while its joint is at zero, from the parent that moves: fixed bodies may be between them.
    above = int(model.body_parentid[child])
    to_parent, turn_parent = _seen_from(data, parent, data.xpos[above], data.xmat[above].reshape(3, 3))
    zero = float(model.qpos0[model.jnt_qposadr[first]])
    axis, own = model.jnt_axis[first], _matrix(model.body_quat[child])
    shift = own @ axis * -zero if kind == _SLIDE else np.zeros(3)
    back = _matrix(_about(axis, -zero)) if kind == _HINGE else np.eye(3)
    _add_origin(robot[-1], to_parent + turn_parent @ (model.body_pos[child] + shift), turn_parent @ own @ back)
    ET.SubElement(robot[-1], "axis", xyz=_numbers(axis))
    if motion != "continuous":
        low, high = model.jnt_range[first].tolist() if limited else (-1.0, 1.0)
        limits = {"lower": low, "upper": high, "effort": 0.0, "velocity": 0.0}
        ET.SubElement(robot[-1], "limit", {key: _numbers(value) for key, value in limits.items()})


def _connect(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> None:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)


def _add_origin(element: ET.Element, place: _Array, turn: _Array) -> None:
    roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    pitch = math.atan2(-turn[2, 0], math.hypot(turn[2, 1], turn[2, 2]))
    element.insert(0, ET.Element("origin", xyz=_numbers(place), rpy=_numbers((roll, pitch, yaw))))


def _seen_from(data: mujoco.MjData, body: int, place: _Array, axes: _Array) -> tuple[_Array, _Array]:
    turn = data.xmat[body].reshape(3, 3).T
    return turn @ (place - data.xpos[body]), turn @ axes


def _matrix(quaternion: _Array) -> _Array:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _about(axis: _Array, angle_rad: float) -> _Array:
    quaternion = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quaternion, axis, angle_rad)
    return quaternion


def _numbers(values: float | Sequence[float] | _Array) -> str:
    return " ".join(f"{float(value):.6g}" for value in np.atleast_1d(values))
