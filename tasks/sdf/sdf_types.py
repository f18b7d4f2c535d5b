"""Types for the content of an SDF world, with all poses in the world's frame, and the list of omitted elements."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import cos, sin
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...schemas.wire.errors import ConfigurationError
from ...schemas.worlds.world import LeftOut

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Rgba = tuple[float, float, float, float]

ShapeKind = Literal["box", "cylinder", "sphere", "ellipsoid", "capsule", "plane", "mesh", "prism", "cone", "heightmap"]
JointKind = Literal["hinge", "slide", "ball", "fixed"]

GRAY: Rgba = (0.7, 0.7, 0.7, 1.0)
"""Colour (RGBA) of a visual that names none: Gazebo's default."""


@dataclass(frozen=True, slots=True)
class Pose:
    """A pose in SDF: position and rotation matrix."""

    position: Vector
    rotation: Matrix

    def __matmul__(self, other: "Pose") -> "Pose":
        """Composes two poses: converts a pose given in this frame to the outer frame."""
        return Pose(self.position + self.rotation @ other.position, self.rotation @ other.rotation)

    def inverse(self) -> "Pose":
        """Returns the inverse of a pose."""
        return Pose(-self.rotation.T @ self.position, self.rotation.T)


def identity() -> Pose:
    """Returns the identity pose."""
    return Pose(np.zeros(3), np.eye(3))


def euler_matrix(roll: float, pitch: float, yaw: float) -> Matrix:
    """Returns the rotation matrix of roll, pitch and yaw in radians, about fixed axes."""
    (cr, sr), (cp, sp), (cy, sy) = ((cos(angle), sin(angle)) for angle in (roll, pitch, yaw))
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip


@dataclass(frozen=True, slots=True)
class Geometry:
    """Shape of an SDF collision or visual."""

    kind: ShapeKind
    size: tuple[float, ...] = ()
    """Size of the shape, in metres.

    Full extents of a box, plane or heightmap, radii of an ellipsoid, radius and length of a cylinder, capsule or cone,
    radius of a sphere, height of a prism.
    """
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Normal of an SDF plane."""
    file: Path | None = None
    """File of an SDF mesh or heightmap."""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    submesh: str | None = None
    is_centred: bool = False
    """Whether a mesh's submesh is moved so that its centre is at the origin."""
    outlines: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Corners of each part of a prism; a hole is joined to the outline around it by an edge in both directions."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of an SDF heightmap in its link, in metres."""

    @property
    def said(self) -> str:
        """Returns the name of the shape's kind in SDF: `polyline` for a prism."""
        return "polyline" if self.kind == "prism" else self.kind


@dataclass(frozen=True, slots=True)
class Material:
    """Material (colour and textures) of an SDF visual."""

    color: Rgba = GRAY
    texture: Path | None = None
    is_stated: bool = False
    """Whether the SDF file names the material; otherwise that of the mesh is used."""


@dataclass(frozen=True, slots=True)
class Collision:
    """A collision shape of an SDF link."""

    name: str
    pose: Pose
    """Pose of a collision shape in the world's frame."""
    geometry: Geometry
    friction: float


@dataclass(frozen=True, slots=True)
class Visual:
    """A visual shape of an SDF link."""

    name: str
    pose: Pose
    geometry: Geometry
    material: Material


@dataclass(frozen=True, slots=True)
class Inertia:
    """Mass and moments of inertia of an SDF link."""

    mass_kg: float
    pose: Pose
    moments: Matrix | None
    """Moments of inertia of a link; `None`: those of a box as large as its shapes."""


@dataclass(slots=True)
class Link:
    """A link (rigid part) of an SDF model."""

    path: str
    """Path of the link: names of the models around it and its own, joined by `::`."""
    model: str
    """Name of the outermost model that the link is in."""
    pose: Pose
    is_static: bool
    inertia: Inertia | None
    collisions: list[Collision]
    visuals: list[Visual]


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint between two SDF links, or a link and the world."""

    path: str
    kind: JointKind
    parent: str
    """Path of a joint's parent link, or `world`."""
    child: str
    pose: Pose
    axis: Vector
    """Direction of a joint's axis in the world's frame."""
    lower: float | None
    """Lower limit of a joint's position, in radians or metres; `None`: unlimited."""
    upper: float | None
    damping: float
    friction: float
    position: float = 0.0
    """Initial position, in radians or metres; not 0 if Gazebo's window saved the links elsewhere."""


@dataclass(frozen=True, slots=True)
class Light:
    """A light of an SDF world."""

    name: str
    kind: Literal["point", "spot", "directional"]
    pose: Pose
    direction: Vector
    diffuse: tuple[float, float, float]
    casts_shadows: bool
    outer_angle_rad: float


class Omissions:
    """Collects what an import left out of a world, by kind."""

    def __init__(self) -> None:
        self._found: dict[str, list[str]] = defaultdict(list)

    def add(self, kind: str, name: str) -> None:
        """Records an element that was left out.

        Args:
            kind: Kind of element, in the plural: `plugins`.
            name: Path or name of the element.
        """
        self._found[kind].append(name)

    def __contains__(self, kind: str) -> bool:
        return kind in self._found

    def names(self, kind: str) -> list[str]:
        """Returns the names of the elements of a kind that an import left out."""
        return sorted(set(self._found.get(kind, [])))

    def as_list(self, most_names: int = 12) -> list[LeftOut]:
        """Lists the left-out elements, with counts and some names of each kind.

        Args:
            most_names: Names that are told of a kind.
        """
        return [
            LeftOut(what=kind, count=len(names), names=sorted(set(names))[:most_names])
            for kind, names in sorted(self._found.items())
        ]


@dataclass(slots=True)
class SdfWorld:
    """An SDF world file with all models that it includes, parsed."""

    name: str
    version: str
    links: list[Link] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    model_types: dict[str, str] = field(default_factory=dict)
    """Kind of each model by its path: the name of the folder that it was included from, or its own name."""
    left_out: Omissions = field(default_factory=Omissions)
    files: set[Path] = field(default_factory=set)
    """Paths of all files that were read for an SDF world."""

    def geometries(self) -> Iterator[Geometry]:
        """Yields the shapes of all links of an SDF world."""
        for link in self.links:
            yield from (each.geometry for each in (*link.collisions, *link.visuals))


class SdfError(ConfigurationError):
    """Raised for an SDF world file that cannot be read; names file and line."""
