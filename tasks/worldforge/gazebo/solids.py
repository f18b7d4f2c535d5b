"""Converts Gazebo's collision shapes to MuJoCo geoms: primitives, boxes and convex hulls, at most 5,000 in a world."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ...sdf.meshes import MeshError, Meshes, Triangles
from ...sdf.sdf_types import Collision, Geometry, Link, Pose, SdfWorld
from .convex_parts import BoxPart, ConvexPart, Points, convex_parts, voxel_boxes
from .prisms import COMPOSED, prism_parts, prism_triangles
from .terrain import Terrain, terrain_of

MOST_SOLIDS = 5000
"""Limit of collision shapes in one imported world: with more, a time step takes milliseconds."""
_MOST_OF_ONE = 1500
"""Limit of the collision shapes of one mesh of an imported world; the walls of a hospital have 1,447."""
_MOST_FACES = 6000
"""Limit of the triangles of a mesh that is split exactly, face by face: some seconds."""
_MOST_OF_LOOSE = 200
"""Limit of the collision shapes of a movable body's mesh: the largest faces are kept, so that the body never grows."""
_MANY = 100
"""Number of collision shapes of one mesh from which on a height field is tried instead."""
_FIRST_PITCH_M = 0.015
_LAST_PITCH_M = 2.0

_UPRIGHT = 1 - 1e-6
"""Upward part of a vertical axis with which a shape is upright, within 0.1 degrees."""
_Part = ConvexPart | Terrain

SolidKind = Literal["box", "cylinder", "sphere", "ellipsoid", "capsule", "plane", "hull", "hfield"]
COARSE = "collision meshes that are coarser than drawn"


@dataclass(frozen=True, slots=True)
class Solid:
    """A collision shape of an imported Gazebo world."""

    kind: SolidKind
    pose: Pose
    """Pose of a collision shape in the world's frame."""
    size: tuple[float, ...]
    """Size of a collision shape as in MuJoCo: half extents; radius; or radius and half length."""
    friction: float
    corners: Points | None = None
    """Corners of a convex hull's collision shape, in its own frame."""
    geometry: Geometry | None = None
    """Gazebo shape that this one is the whole conversion of; `None` for parts of a mesh."""
    terrain: Terrain | None = None
    """Heights of a height field that was made from a mesh."""


class _Key(NamedTuple):
    """Key of a mesh's collision shapes: a mesh that moves gets other shapes than a fixed one."""

    geometry: Geometry
    is_loose: bool


class SolidMaker:
    """Makes collision shapes of Gazebo links, coarser ones if there would be too many.

    Args:
        world: The world; what had to be made coarser is noted in its list.
        meshes: Reads the world's meshes.
        loose: Paths of the links that can move.
    """

    def __init__(self, world: SdfWorld, meshes: Meshes, loose: Iterable[str]) -> None:
        self._world, self._meshes, self._loose = world, meshes, set(loose)
        self._triangles: dict[Geometry, Triangles | None] = {}
        # Maps of terrain are drawn for terrain that stands upright.
        self._tilted = {
            collision.geometry
            for link in world.links
            for collision in link.collisions
            if collision.pose.rotation[2, 2] < _UPRIGHT
        }
        self._parts = self._all_parts()

    def solids(self, link: Link) -> list[Solid]:
        """Returns the collision shapes of a Gazebo link."""
        return [solid for collision in link.collisions for solid in self._of(collision, link.path in self._loose)]

    def _of(self, collision: Collision, is_loose: bool) -> Iterator[Solid]:
        geometry, pose, friction = collision.geometry, collision.pose, collision.friction
        if (parts := self._parts.get(_Key(geometry, is_loose))) is not None:
            for part in parts:
                if isinstance(part, Terrain):
                    placed = pose @ Pose(part.lowest, np.eye(3))
                    yield Solid("hfield", placed, part.size, friction, terrain=part)
                elif isinstance(part, BoxPart):
                    yield Solid("box", pose @ Pose(part.center, part.rotation), tuple(part.half.tolist()), friction)
                else:
                    middle = part.corners.mean(axis=0)
                    yield Solid("hull", pose @ Pose(middle, np.eye(3)), (), friction, corners=part.corners - middle)
        elif geometry.kind not in COMPOSED:
            yield primitive(geometry, pose, friction, is_static=not is_loose)

    def _all_parts(self) -> Mapping[_Key, list[_Part]]:
        counts = Counter(
            _Key(collision.geometry, link.path in self._loose)
            for link in self._world.links
            for collision in link.collisions
        )
        simple = sum(count for key, count in counts.items() if key.geometry.kind not in COMPOSED)
        parts = {key: self._first(key) for key in counts if key.geometry.kind in COMPOSED}
        pitches: dict[_Key, float] = defaultdict(lambda: _FIRST_PITCH_M)
        while simple + sum(counts[key] * len(made) for key, made in parts.items()) > MOST_SOLIDS:
            worst = max(
                (key for key in parts if pitches[key] < _LAST_PITCH_M and len(parts[key]) > 1),
                key=lambda key: counts[key] * len(parts[key]),
                default=None,
            )
            if worst is None:
                break
            pitches[worst] *= 2
            parts[worst] = self._coarser(worst, pitches[worst], parts[worst])
        return parts

    def _first(self, key: _Key) -> list[_Part]:
        if key.geometry.kind != "mesh":
            return [*prism_parts(key.geometry)]
        triangles = self._read(key.geometry)
        if triangles is None:
            return []
        if len(triangles) <= _MOST_FACES:
            parts, is_coarse = convex_parts(triangles, is_loose=key.is_loose)
            if len(parts) > _MANY and (terrain := self._terrain(key, triangles)) is not None and terrain.is_closed:
                return [terrain]
            if len(parts) <= (_MOST_OF_LOOSE if key.is_loose else _MOST_OF_ONE):
                if is_coarse:
                    self._note(key)
                return [*parts]
            if key.is_loose:
                self._note(key)
                return [*parts[:_MOST_OF_LOOSE]]
        elif key.is_loose:
            self._note(key)
            largest = np.argsort(-_areas(triangles), kind="stable")[:_MOST_FACES]
            return [*convex_parts(triangles[largest], is_loose=True).parts[:_MOST_OF_LOOSE]]
        if (terrain := self._terrain(key, triangles)) is not None:
            return [terrain]
        # Cells as large as a hundredth of the mesh, within what is fine for a robot.
        extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
        return self._coarser(key, min(max(extent / 100, _FIRST_PITCH_M), 0.08), None)

    def _terrain(self, key: _Key, triangles: Triangles) -> Terrain | None:
        return None if key.is_loose or key.geometry in self._tilted else terrain_of(triangles)

    def _coarser(self, key: _Key, pitch_m: float, before: list[_Part] | None) -> list[_Part]:
        """Returns the collision shapes of a mesh with fewer parts.

        Movable bodies keep the largest half of the faces; other meshes become boxes on a grid.
        """
        self._note(key)
        if before is not None and key.is_loose:
            return before[: max(1, len(before) // 2)]
        triangles = self._read(key.geometry) if key.geometry.kind == "mesh" else prism_triangles(key.geometry)
        boxes: list[_Part] = [*voxel_boxes(triangles, pitch_m)] if triangles is not None else []
        return boxes if before is None or len(boxes) < len(before) else before

    def _note(self, key: _Key) -> None:
        name = key.geometry.file.name if key.geometry.file else key.geometry.said
        if name not in self._world.left_out.names(COARSE):
            self._world.left_out.add(COARSE, name)

    def _read(self, geometry: Geometry) -> Triangles | None:
        if geometry not in self._triangles:
            try:
                self._triangles[geometry] = self._meshes.triangles(geometry)
            except MeshError as error:
                self._world.left_out.add("meshes that cannot be read", error.short)
                self._triangles[geometry] = None
        return self._triangles[geometry]


def _areas(triangles: Triangles) -> Points:
    return np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)


def primitive(geometry: Geometry, pose: Pose, friction: float, *, is_static: bool = True) -> Solid:
    """Converts a primitive Gazebo shape to a MuJoCo collision shape.

    Args:
        geometry: The shape.
        pose: Pose of the shape in the world.
        friction: Sliding friction of the shape.
        is_static: Whether it never moves: only then a plane can be one, otherwise it is a thin box.
    """
    size = geometry.size
    match geometry.kind:
        case "box":
            made: tuple[SolidKind, tuple[float, ...]] = "box", tuple(extent / 2 for extent in size)
        case "sphere":
            made = "sphere", size
        case "ellipsoid":
            made = "ellipsoid", size
        case "cylinder" | "capsule":
            made = geometry.kind, (size[0], size[1] / 2)
        case "heightmap":
            made = "hfield", size
            pose = pose @ Pose(np.array(geometry.offset), np.eye(3))
        case _:
            pose = pose @ Pose(np.zeros(3), _to_normal(geometry.normal))
            made = "plane", (size[0] / 2, size[1] / 2)
            if not is_static:
                thick = Pose(np.array([0.0, 0.0, -0.01]), np.eye(3))
                return Solid("box", pose @ thick, (size[0] / 2, size[1] / 2, 0.01), friction)
    return Solid(made[0], pose, made[1], friction, geometry=geometry)


def _to_normal(normal: tuple[float, float, float]) -> Points:
    """Returns a rotation matrix that turns the z axis to a plane's normal."""
    z = np.array(normal) / np.linalg.norm(normal)
    x = np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.9 else (1.0, 0.0, 0.0), z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
