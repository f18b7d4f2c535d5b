"""Reads joints of an SDF world: kind, pose, axis and limits, and positions in the state that Gazebo's window saved."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from math import atan2

import numpy as np

from .frames import Scope
from .sdf_types import Joint, JointKind, Link, Omissions, Pose, Vector, identity
from .xml_files import flag_of, number_of, numbers_of, text_of

_KINDS: dict[str, JointKind] = {
    "revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "ball": "ball", "fixed": "fixed",
}  # fmt: skip
_LIMITLESS = 1e6
"""Joint limits beyond this value (radians or metres) count as unlimited: files say 1e16."""
_LEAST_SAVED_M = 1e-9
"""Smallest difference between saved pose entries that counts: Gazebo's window saves six digits."""


@dataclass(frozen=True, slots=True)
class JointPlace:
    """A joint element, with the model or world that it is in."""

    element: ET.Element
    scope: Scope
    pose: Pose
    """Pose of the joint's model in the world's frame."""
    prefix: str
    """Path of the joint's model; empty: the joint is in the world."""
    version: str
    """SDF version of the file that a joint is in."""


@dataclass(frozen=True, slots=True)
class _Moved:
    """Frames of a joint at its links' saved poses, and the joint's displacement from the model's poses."""

    pose: Pose
    axis: Vector
    position: float


def read_joint(found: JointPlace, links: Mapping[str, Link], left_out: Omissions) -> Joint:
    """Reads a joint; one of a kind that MuJoCo does not have is fixed, and noted.

    Args:
        found: The joint.
        links: All links of the world by path, where they are saved.
        left_out: Gets what was left out.

    Raises:
        SdfError: A number in it is none.
    """
    element, kind_said = found.element, found.element.get("type", "")
    path = "::".join(filter(None, (found.prefix, element.get("name", "joint"))))
    kind = _KINDS.get(kind_said)
    if kind is None:
        left_out.add(f"joints of type {kind_said[:40]}, which are held", path)
        kind = "fixed"
    axis = element.find("axis")
    lower, upper = _limits(axis, kind_said)
    kind = "fixed" if lower is not None and lower == upper else kind
    placed = found.pose @ found.scope.pose_of_part(element)
    moved = _as_saved(found, links, kind, placed, _axis(axis, found, placed))
    dynamics = _child(axis, "dynamics")
    return Joint(
        path=path,
        kind=kind,
        parent=_end(found, "parent"),
        child=_end(found, "child"),
        pose=moved.pose,
        axis=moved.axis,
        lower=lower,
        upper=upper,
        damping=0.0 if dynamics is None else number_of(dynamics, "damping", 0.0),
        friction=0.0 if dynamics is None else number_of(dynamics, "friction", 0.0),
        position=moved.position,
    )


def _as_saved(found: JointPlace, links: Mapping[str, Link], kind: JointKind, placed: Pose, axis: Vector) -> _Moved:
    """Returns the joint between its links at their saved poses, as Gazebo uses the poses of links, not saved angles."""
    ends: list[tuple[Pose, Pose]] = []
    for tag in ("parent", "child"):
        name = text_of(found.element, tag)
        link = links.get(_end(found, tag))
        if name == "world":
            ends.append((identity(), identity()))
        elif link is not None and found.scope.has(name):
            ends.append((found.pose @ found.scope.resolve(found.scope.link_of(name)), link.pose))
    if len(ends) < 2 or all(_same(stated, saved) for stated, saved in ends):
        return _Moved(placed, axis, 0.0)
    (parent, parent_now), (child, child_now) = ends
    by_parent = parent_now @ parent.inverse() @ placed
    by_child = child_now @ child.inverse() @ placed
    along = parent_now.rotation @ parent.rotation.T @ axis
    position = 0.0
    if kind == "hinge":
        position = _angle(by_child.rotation @ by_parent.rotation.T, along)
    elif kind == "slide":
        position = float((by_child.position - by_parent.position) @ along)
    return _Moved(by_child, along, position)


def _same(one: Pose, other: Pose) -> bool:
    away = max(np.abs(one.position - other.position).max(), np.abs(one.rotation - other.rotation).max())
    return bool(away < _LEAST_SAVED_M)


def _angle(rotation: np.ndarray, axis: Vector) -> float:
    """Returns the angle of a rotation about an axis, between -pi and pi radians."""
    sines = np.array([
        rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]
    ])  # fmt: skip
    return atan2(float(sines @ axis), float(np.trace(rotation)) - 1.0)


def _child(element: ET.Element | None, tag: str) -> ET.Element | None:
    return None if element is None else element.find(tag)


def _end(found: JointPlace, tag: str) -> str:
    """Returns the path of the link at one end of a joint, which may be named by a frame; or `world`."""
    name = text_of(found.element, tag)
    if name == "world":
        return name
    return "::".join(filter(None, (found.prefix, found.scope.link_of(name))))


def _limits(axis: ET.Element | None, kind: str) -> tuple[float | None, float | None]:
    limit = _child(axis, "limit")
    if limit is None or kind == "continuous":
        return None, None
    lower = number_of(limit, "lower", -1e16, is_endless=True)
    upper = number_of(limit, "upper", 1e16, is_endless=True)
    if lower > upper:
        return None, None
    return (lower if abs(lower) < _LIMITLESS else None), (upper if abs(upper) < _LIMITLESS else None)


def _axis(axis: ET.Element | None, found: JointPlace, joint: Pose) -> Vector:
    """Returns a joint's axis as a unit vector in the world's frame; before SDF 1.5 it was given in the model's frame.

    A missing axis, or one of length 0, is the z axis.
    """
    element = _child(axis, "xyz")
    along = np.array(numbers_of(element, 3, (0.0, 0.0, 1.0)))
    if not np.linalg.norm(along) > 0:
        along = np.array((0.0, 0.0, 1.0))
    expressed = element.get("expressed_in", "") if element is not None else ""
    if expressed:
        turned = found.pose.rotation @ found.scope.resolve(expressed).rotation
    elif axis is not None and flag_of(axis, "use_parent_model_frame", found.version in ("1.3", "1.4")):
        turned = found.pose.rotation
    else:
        turned = joint.rotation
    along = turned @ along
    return along / np.linalg.norm(along)
