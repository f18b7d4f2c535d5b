"""Solid parts of a world's MJCF, read as XML, and how far they overlap: shares no code with MuJoCo or the product.

Two convex shapes overlap by as much as they do in the direction in which they overlap least. For boxes these
directions are known; for round shapes a thousand are tried, so that the answer is a little too large, never too small.
"""

import itertools
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SolidShape:
    """A box, cylinder, sphere or ellipsoid that collides."""

    name: str
    piece: str
    """Its body, its piece of furniture, or nothing: the building."""
    kind: str
    center: Array
    axes: Array
    """Columns are its own axes."""
    size: Array

    def reach(self, directions: Array) -> Array:
        """How far it reaches from its middle in each direction."""
        local = directions @ self.axes
        if self.kind == "box":
            return np.abs(local) @ self.size
        if self.kind == "cylinder":
            return self.size[0] * np.hypot(local[:, 0], local[:, 1]) + self.size[1] * np.abs(local[:, 2])
        return np.linalg.norm(local * (self.size if self.kind == "ellipsoid" else self.size[0]), axis=1)

    @property
    def half(self) -> Array:
        """Half the extents of the box around it."""
        return self.reach(np.eye(3))


def solid_shapes(mjcf: str) -> list[SolidShape]:
    """All solid parts of a world, without the plane below it."""
    root = ET.fromstring(mjcf).find("worldbody")
    assert root is not None
    found = [_shape(geom, "", np.zeros(3), np.eye(3)) for geom in root.findall("geom") if _is_solid(geom)]
    for body in root.findall("body"):
        name, turn = body.get("name", ""), _turned(_numbers(body.get("euler", "0 0 0"))[2])
        place = _numbers(body.get("pos", "0 0 0"))
        found += [_shape(geom, name, place, turn) for geom in body.findall("geom") if _is_solid(geom)]
    return found


def deep_overlaps(mjcf: str, limit_m: float) -> dict[frozenset[str], float]:
    """Pairs of solid parts of different pieces that overlap by more than a limit, by their names."""
    found: dict[frozenset[str], float] = {}
    for one, other in itertools.combinations(solid_shapes(mjcf), 2):
        if one.piece != other.piece and np.all(np.abs(one.center - other.center) < one.half + other.half - limit_m):
            depth_m = overlap_m(one, other)
            if depth_m > limit_m:
                found[frozenset((one.name, other.name))] = depth_m
    return found


def overlap_m(one: SolidShape, other: SolidShape) -> float:
    """How far two shapes overlap; negative if they are apart."""
    directions = [*one.axes.T, *other.axes.T]
    directions += [np.cross(a, b) for a in one.axes.T for b in other.axes.T]
    tried = np.array([each / norm for each in directions if (norm := np.linalg.norm(each)) > 1e-9])
    if {one.kind, other.kind} != {"box"}:
        tried = np.vstack([tried, _round_about()])
    return float(np.min(one.reach(tried) + other.reach(tried) - np.abs(tried @ (other.center - one.center))))


def _round_about(count: int = 1000) -> Array:
    """Directions to all sides, evenly, and the horizontal ones once more."""
    number = np.arange(count) + 0.5
    up, angle = 1 - 2 * number / count, np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - up**2)
    sphere = np.stack([flat * np.cos(angle), flat * np.sin(angle), up], axis=1)
    ring = np.linspace(0, np.pi, 180, endpoint=False)
    return np.vstack([sphere, np.stack([np.cos(ring), np.sin(ring), 0 * ring], axis=1)])


def _is_solid(geom: ET.Element) -> bool:
    return geom.get("contype") != "0" and geom.get("type") != "plane"


def _shape(geom: ET.Element, body: str, place: Array, turn: Array) -> SolidShape:
    name = geom.get("name", "")
    furniture, dot, _ = name.partition(".")
    piece = body or (furniture if dot else "")
    center = place + turn @ _numbers(geom.get("pos", "0 0 0"))
    axes = turn @ _rotation(_numbers(geom.get("quat", "1 0 0 0")))
    return SolidShape(name, piece, geom.get("type", ""), center, axes, _numbers(geom.get("size", "")))


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _turned(yaw: float) -> Array:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _rotation(quat: Array) -> Array:
    w, x, y, z = quat / np.linalg.norm(quat)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
