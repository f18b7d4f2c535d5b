"""Rigid bodies of an imported Gazebo world: links that are fixed to each other form one body; joints connect bodies."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from ...sdf.sdf_types import Inertia, Joint, Link, Matrix, Pose, SdfWorld, Vector
from .solids import Solid, SolidMaker

WORLD = "world"
_USUAL_MASS_KG = 1.0
"""Mass of a link that names none, in kilograms: Gazebo's own default."""
_SMALLEST_M = 0.01
"""Smallest extent used to compute moments of inertia of a body that names none, in metres."""


@dataclass(slots=True)
class Body:
    """A rigid body of an imported Gazebo world, made of links that move together."""

    name: str
    links: list[Link]
    pose: Pose
    joint: Joint | None = None
    """Joint that connects an imported body; `None`: it moves freely, or never."""
    is_reversed: bool = False
    """Whether this body is the parent in the file's joint, so that the joint is used in reverse."""
    parent: "Body | None" = None
    """Body that an imported body is attached to by its joint; `None`: the world."""
    is_held: bool = False
    """Whether an imported body could move and is kept fixed."""
    solids: list[Solid] = field(default_factory=list)

    @property
    def model(self) -> str:
        """Name of the outermost Gazebo model that the body is part of."""
        return self.links[0].model


def tie_bodies(world: SdfWorld) -> tuple[list[Body], list[Link]]:
    """Groups the links of a Gazebo world into bodies that can move, and links that never do.

    Args:
        world: The world; joints that cannot be made are noted in its list.

    Returns:
        The bodies, each after the one that it hangs on, and the links of what never moves.
    """
    known = {link.path: link for link in world.links}
    joints = [joint for joint in world.joints if _has_links(joint, known, world)]
    groups = _Groups([WORLD, *known])
    for link in world.links:
        if link.is_static:
            groups.join(WORLD, link.path)
    for joint in joints:
        if joint.kind == "fixed":
            groups.join(joint.parent, joint.child)
    tied: dict[str, tuple[str, Joint, bool]] = {}
    for joint in joints:
        if joint.kind != "fixed":
            _tie(joint, groups, tied, world)
    fixed = groups.root(WORLD)
    members: dict[str, list[Link]] = {}
    for link in world.links:
        members.setdefault(groups.root(link.path), []).append(link)
    bodies = {root: Body(links[0].path, links, links[0].pose) for root, links in members.items() if root != fixed}
    for root, body in bodies.items():
        if root in tied:
            above, body.joint, body.is_reversed = tied[root]
            body.parent = bodies.get(above)
    return _in_order(bodies.values()), members.get(fixed, [])


def _has_links(joint: Joint, known: dict[str, Link], world: SdfWorld) -> bool:
    good = all(name == WORLD or name in known for name in (joint.parent, joint.child))
    if not good:
        world.left_out.add("joints without their links", joint.path)
    return good


def _tie(joint: Joint, groups: "_Groups", tied: dict[str, tuple[str, Joint, bool]], world: SdfWorld) -> None:
    """Records a joint between two groups of links; a joint that would close a loop is left out.

    The entry is added to `tied` under the child's group: its parent's group, the joint, and whether it is reversed.
    Joints that are left out are counted in `world.left_out`.
    """
    parent, child, fixed = groups.root(joint.parent), groups.root(joint.child), groups.root(WORLD)
    if parent == child:
        return  # between parts that never move
    is_reversed = child == fixed or (child in tied and parent not in tied and parent != fixed)
    if is_reversed:
        parent, child = child, parent
    above = parent
    while above in tied and above != child:
        above = tied[above][0]
    if child in tied or child == fixed or above == child:
        world.left_out.add("joints that close a loop", joint.path)
        return
    tied[child] = parent, joint, is_reversed


class _Groups:
    """Disjoint sets of link names (union-find)."""

    def __init__(self, names: Iterable[str]) -> None:
        self._above = {name: name for name in names}

    def root(self, name: str) -> str:
        while self._above[name] != name:
            self._above[name] = self._above[self._above[name]]
            name = self._above[name]
        return name

    def join(self, one: str, other: str) -> None:
        self._above[self.root(other)] = self.root(one)


def _in_order(bodies: Iterable[Body]) -> list[Body]:
    left, found, placed = list(bodies), [], set[int]()
    while left:
        ready = [body for body in left if body.parent is None or id(body.parent) in placed]
        found += ready
        placed |= {id(body) for body in ready}
        left = [body for body in left if id(body) not in placed]
    return found


def make_solids(bodies: list[Body], fixed: list[Link], maker: SolidMaker) -> list[tuple[Link, Solid]]:
    """Makes the collision shapes of all bodies of a Gazebo world.

    Args:
        bodies: All that can move.
        fixed: Links that never do.
        maker: Makes solids.

    Returns:
        The solids of what never moves, each with its link.
    """
    for body in bodies:
        body.solids = [solid for link in body.links for solid in maker.solids(link)]
    return [(link, solid) for link in fixed for solid in maker.solids(link)]


def body_inertia(body: Body) -> Inertia:
    """Computes a body's mass, centre of mass and moments of inertia.

    Links that state no inertia count with a usual mass. Moments are about the centre of mass, along the world's axes.
    """
    parts = [link.inertia or Inertia(_USUAL_MASS_KG, _middle(body), None) for link in body.links]
    whole_kg = sum(part.mass_kg for part in parts)
    center = sum((part.mass_kg * part.pose.position for part in parts), np.zeros(3)) / whole_kg
    moments = np.zeros((3, 3))
    for part in parts:
        own = _box_moments(body, part.mass_kg) if part.moments is None else _turned(part.moments, part.pose.rotation)
        away = part.pose.position - center
        moments += own + part.mass_kg * (away @ away * np.eye(3) - np.outer(away, away))
    return Inertia(whole_kg, Pose(center, np.eye(3)), moments)


def _turned(moments: Matrix, rotation: Matrix) -> Matrix:
    return rotation @ moments @ rotation.T


def solid_corners(solid: Solid) -> Vector:
    """Returns the corners of a box around a collision shape, shape (n, 3).

    They are in the frame that the solid's pose is in. A plane has no extent: its corners are all at its place.
    """
    if solid.corners is not None:
        return solid.pose.position + solid.corners @ solid.pose.rotation.T
    size = solid.size
    match solid.kind:
        case "box" | "ellipsoid":
            half = np.array(size)
        case "sphere":
            half = np.full(3, size[0])
        case "cylinder":
            half = np.array([size[0], size[0], size[1]])
        case "capsule":
            half = np.array([size[0], size[0], size[1] + size[0]])
        case "hfield":
            low, high = np.array([-size[0] / 2, -size[1] / 2, 0.0]), np.array([size[0] / 2, size[1] / 2, size[2]])
            middle, half = (low + high) / 2, (high - low) / 2
            return solid.pose.position + (middle + _SIGNS * half) @ solid.pose.rotation.T
        case _:
            half = np.zeros(3)
    return solid.pose.position + (_SIGNS * half) @ solid.pose.rotation.T


_SIGNS = np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))).reshape(3, -1).T


def _extent(body: Body) -> tuple[Vector, Vector]:
    corners = [solid_corners(solid) for solid in body.solids]
    if not corners:
        return body.pose.position - 0.05, body.pose.position + 0.05
    together = np.concatenate(corners)
    return together.min(axis=0), together.max(axis=0)


def _middle(body: Body) -> Pose:
    low, high = _extent(body)
    return Pose((low + high) / 2, np.eye(3))


def _box_moments(body: Body, mass_kg: float) -> Matrix:
    low, high = _extent(body)
    x, y, z = np.maximum(high - low, _SMALLEST_M) ** 2
    return mass_kg / 12 * np.diag([y + z, x + z, x + y])


def moved(world: SdfWorld, shift: Pose) -> None:
    """Moves a whole Gazebo world by a pose.

    Args:
        world: The world, which is changed.
        shift: Pose of its old origin in the new frame.
    """
    for link in world.links:
        link.pose = shift @ link.pose
        if link.inertia is not None:
            link.inertia = replace(link.inertia, pose=shift @ link.inertia.pose)
        link.collisions = [replace(each, pose=shift @ each.pose) for each in link.collisions]
        link.visuals = [replace(each, pose=shift @ each.pose) for each in link.visuals]
    turn = shift.rotation
    world.joints = [replace(each, pose=shift @ each.pose, axis=turn @ each.axis) for each in world.joints]
    world.lights = [replace(each, pose=shift @ each.pose, direction=turn @ each.direction) for each in world.lights]
