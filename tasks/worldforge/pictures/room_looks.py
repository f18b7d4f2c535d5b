"""Colours of what is seen in a room: patterns of floors and walls, thresholds, the grain of wood, lamps that shine."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import re

import mujoco
import numpy as np

from ....schemas.worlds.world import Passage, World
from ..decor.lights import LAMP_SHADE
from ..decor.openings import LAID
from ..geometry.boxes import Box, strip
from ..materials.materials import surface_name
from ..materials.textures import sample, texture_size_m
from .outside import noise
from .ray_casting import Array, Hits

SMOOTH = ("Linoleum", "Parquetry", "Tiles")
"""Materials of floors that mirror: lacquered, waxed or glazed."""

THRESHOLD_M = 0.05
"""Width of the strip that covers the joint of two floors."""
THRESHOLD_COLOR = (0.62, 0.54, 0.43)

_GRAIN_PER_M = (1.3, 42.0)
"""Bumps of the grain of wood, along a board and across it."""
_GRAIN = 0.22
"""Difference between the lightest and the darkest wood of a board, of 1."""
_WARM, _SATURATED = 0.07, 0.16
"""A plain colour is taken for wood if there is so much more red than green, and red than blue."""
_EDGE_M = 0.007
"""Width of the rounded edges of furniture, which catch light."""
_BUMP_M, _BUMP = 0.004, 0.55
"""Distance at which a pattern's brightness is compared, and how much a surface turns by it: dark joints lie deeper."""
_GLOSS = {
    "mirror": (0.8, 0.9),
    "screen": (0.05, 0.9),
    "glaze": (0.035, 0.6),
    "stone": (0.04, 0.6),
    "lacquer": (0.03, 0.4),
    "steel": (0.3, 0.7),
}
"""Shares of light that are mirrored, looking straight at a surface and along it."""
_GLOSSY: tuple[tuple[tuple[str, ...], str], ...] = (
    ((r"\.mirror$", r"^mirror_.*_glass$"), "mirror"),
    ((r"\.screen", r"\.television$", r"\.display", r"\.glass", r"\.window", r"\.hob", r"\.door-glass"), "screen"),
    ((r"\.sink", r"\.spout", r"\.tap"), "steel"),
    ((r"^(Storage|VanityCounters|KitchenIslands\w*|DishWashers|Wash\w*)_\d+\.top",), "stone"),
    ((r"^(Fridges|Ovens|DishWashers|Wash\w*)_", r"\.tank", r"^Baths_", r"^Showers_"), "glaze"),
    ((r"\.(top|front-|body|board)", r"^cabinet_", r"^(Dining|Coffee|Side|Console)Tables_\d+\.top"), "lacquer"),
)
"""Beginnings and parts of names of geoms that mirror, by their kind of gloss; the first that fits counts."""
_NO_WOOD = ("cover", "blanket", "cushion", "pillow", "soft", "shade", "mattress", "throw")


class Looks:
    """Colours of a world's geoms and surfaces.

    Args:
        model: The compiled world, decorated; its materials are named like surfaces.
        world: The world.
    """

    def __init__(self, model: mujoco.MjModel, world: World) -> None:
        material = np.maximum(model.geom_matid, 0)
        has_material = model.geom_matid >= 0
        plain = model.geom_rgba[:, :3].astype(float)
        if model.nmat:
            plain = np.where(has_material[:, None], model.mat_rgba[material, :3], plain)
        self._plain = plain
        self._surfaces = [model.mat(index).name.removesuffix(LAID) for index in range(model.nmat)]
        self._materials = np.where(has_material, model.geom_matid, -1)
        self.names = [model.geom(index).name for index in range(model.ngeom)]
        shades = [self._is_shade(index) for index in range(model.ngeom)]
        self._shade = np.array(shades, np.bool_)
        self._wood = np.array([self._is_wood(index) for index in range(model.ngeom)], np.bool_)
        self._sharp = (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX) & ~has_material
        self._half = model.geom_aabb[:, 3:].astype(float)
        self._middle = model.geom_aabb[:, :3].astype(float)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._places, self._turns = data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()
        self._thresholds = [threshold(passage) for passage in world.floorplan.passages if has_joint(passage, world)]

    def gloss(self) -> Array:
        """Returns the shares of light that geoms mirror, straight and along the surface, shape (geoms, 2)."""
        return np.array([self._gloss(number) for number in range(len(self.names))])

    def _gloss(self, number: int) -> tuple[float, float]:
        name, material = self.names[number], int(self._materials[number])
        surface = self._surfaces[material] if material >= 0 else ""
        if surface.startswith("floor_"):
            return _GLOSS["glaze"] if surface.startswith(tuple(f"floor_{kind}_" for kind in SMOOTH)) else (0.0, 0.0)
        if surface.startswith("wall_"):
            return _GLOSS["glaze"] if surface.startswith("wall_Tiles_") else (0.0, 0.0)
        part = name.removesuffix("_seen")
        fits = [kind for words, kind in _GLOSSY if any(re.search(word, part) for word in words)]
        return _GLOSS[fits[0]] if fits else (0.0, 0.0)

    def bent(self, hits: Hits) -> Array:
        """Returns the directions that surfaces have for light: edges are round, and patterns have bumps."""
        known = np.maximum(hits.geoms, 0)
        bent = hits.normals.copy()
        mine = np.flatnonzero((hits.geoms >= 0) & self._sharp[known])
        if len(mine):
            bent[mine] = self._rounded(hits[mine])
        materials = np.where(hits.geoms >= 0, self._materials[known], -1)
        for index in np.unique(materials[materials >= 0]):
            name = self._surfaces[index]
            if name.startswith(("floor_", "wall_")) and texture_size_m(name) is not None:
                mine = np.flatnonzero(materials == index)
                bent[mine] = _bumpy(name, hits[mine])
        return bent / np.maximum(np.linalg.norm(bent, axis=1), 1e-6)[:, None]

    def _rounded(self, hits: Hits) -> Array:
        """Directions of the surfaces of boxes, whose edges are round."""
        geoms = hits.geoms
        turns, half = self._turns[geoms], self._half[geoms]
        inside = np.einsum("nji,nj->ni", turns, hits.places - self._places[geoms]) - self._middle[geoms]
        radius = np.minimum(_EDGE_M, 0.3 * half)
        over = np.clip((np.abs(inside) - (half - radius)) / radius, 0, 1)
        # Twice as deep in the middle of an edge: light changes there, as on a curve that is seen from afar.
        local = np.sign(inside) * over**1.5
        return np.einsum("nij,nj->ni", turns, local) + hits.normals * 0.35

    def colors(self, hits: Hits) -> Array:
        """Returns the surface colours at ray hits; those of shining surfaces are negative."""
        known = np.maximum(hits.geoms, 0)
        colors = self._plain[known].astype(float)
        materials = np.where(hits.geoms >= 0, self._materials[known], -1)
        for index in np.unique(materials[materials >= 0]):
            name = self._surfaces[index]
            if not name.startswith(("floor_", "wall_")):
                continue
            mine = np.flatnonzero(materials == index)
            colors[mine] = self._floor(name, hits[mine]) if name.startswith("floor_") else _wall(name, hits[mine])
        special = (hits.geoms >= 0) & self._wood[known]
        mine = np.flatnonzero(special)
        colors[mine] *= self._worked(hits[mine])[:, None]
        shades = np.flatnonzero((hits.geoms >= 0) & self._shade[known])
        colors[shades] *= -(0.93 + 0.07 * hits.normals[shades, 2:])  # brighter above, where the bulb is
        return colors

    def _is_shade(self, number: int) -> bool:
        name, material = self.names[number], int(self._materials[number])
        return (material >= 0 and self._surfaces[material] == LAMP_SHADE) or name.removesuffix("_seen").endswith(
            ".shade"
        )

    def _is_wood(self, number: int) -> bool:
        red, green, blue = self._plain[number]
        part = self.names[number].partition(".")[2]
        is_furniture = bool(part) and not any(word in part for word in _NO_WOOD)
        return is_furniture and self._materials[number] < 0 and red - green > _WARM and red - blue > _SATURATED

    def _floor(self, name: str, hits: Hits) -> Array:
        x, y, _ = hits.places.T
        colors = sample(name, x, y) / 255.0
        for west, south, east, north in self._thresholds:
            on = (x > west) & (x < east) & (y > south) & (y < north)
            colors = np.where(on[:, None], np.array(THRESHOLD_COLOR), colors)
        return colors

    def _worked(self, hits: Hits) -> Array:
        """Brightness of the grain of wood at places."""
        geoms = hits.geoms
        inside = np.einsum("nji,nj->ni", self._turns[geoms], hits.places - self._places[geoms]) - self._middle[geoms]
        half = self._half[geoms]
        order = np.argsort(-half, axis=1)
        along, across, through = (np.take_along_axis(inside, order[:, [axis]], 1)[:, 0] for axis in range(3))
        # Each board is cut from another place of the tree.
        shift = geoms * 7.31
        grain = noise(along * _GRAIN_PER_M[0] + shift, (across + through) * _GRAIN_PER_M[1] + shift * 3)
        rings = noise(along * 0.6 + shift, (across + 0.7 * through) * 9 + shift)
        return np.where(self._wood[geoms], 1 + _GRAIN * (0.55 * grain + 0.45 * rings - 0.5), 1.0)


def _bumpy(name: str, hits: Hits) -> Array:
    """Directions of a patterned surface: it slopes where its brightness changes."""
    x, y, z = hits.places.T
    upright = np.abs(hits.normals[:, 2]) < 0.5
    on_y = np.abs(hits.normals[:, 0]) > 0.5
    u, v = np.where(upright & on_y, y, x), np.where(upright, z, y)
    here = sample(name, u, v).mean(axis=1) / 255.0
    right = (sample(name, u + _BUMP_M, v).mean(axis=1) / 255.0 - here) * _BUMP
    up = (sample(name, u, v + _BUMP_M).mean(axis=1) / 255.0 - here) * _BUMP
    bent = hits.normals.copy()
    bent[:, 0] -= np.where(upright & on_y, 0.0, right)
    bent[:, 1] -= np.where(upright, np.where(on_y, right, 0.0), up)
    bent[:, 2] -= np.where(upright, up, 0.0)
    return bent


def _wall(name: str, hits: Hits) -> Array:
    """Colours of places on a wall."""
    x, y, z = hits.places.T
    along = np.where(np.abs(hits.normals[:, 0]) > 0.5, y, x)
    return sample(name, along, z) / 255.0


def has_joint(passage: Passage, world: World) -> bool:
    """Whether two different floors meet in a passage."""
    rooms = {room.name: room for room in world.floorplan.rooms}
    one, other = (surface_name("floor", rooms[name]) for name in passage.rooms)
    return one != other


def threshold(passage: Passage) -> Box:
    """Returns the rectangle that a threshold covers, between the jambs of its passage."""
    return strip(passage.start, passage.end, THRESHOLD_M / 2)
