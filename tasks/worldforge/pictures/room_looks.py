"""Colours of what is seen in a room: patterns of floors and walls, thresholds, the grain of wood, lamps that shine."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import re

import mujoco
import numpy as np

from ....schemas.worlds.world import Passage, World
from ..decor.lights_and_ceilings import LAMP_SHADE
from ..decor.openings import LAID
from ..geometry.boxes import Box, room_rects, strip
from ..geometry.parts import Vector
from ..materials.materials import surface_name
from ..materials.textures import sample, texture_size_m
from .fine_forms import drawn, is_cloth, is_panelled, panel, weave
from .outside import noise
from .ray_casting import Array, Flags, Hits, Ids

SMOOTH = ("Linoleum", "Parquetry", "Tiles")
"""Materials of floors that mirror: lacquered, waxed or glazed."""

THRESHOLD_M = 0.05
"""Width of the strip that covers the joint of two floors, in metres."""
THRESHOLD_COLOR = (0.62, 0.54, 0.43)

_GRAIN_PER_M = (1.3, 42.0)
"""Bumps of the grain of wood in a metre, along a board and across it."""
_GRAIN = 0.22
"""Difference of brightness between the lightest and the darkest wood of a board, as a share of the whole."""
_WARM, _RED, _SATURATED, _LEAST_BLUE = 0.07, 0.25, 0.16, 0.3
"""Limits of a plain colour that is taken for wood, as cloth is more colourful.

They are: least and most excess of red over green, least excess of red over blue, and least blue for its red.
"""
_EDGE_M = 0.007
"""Width of the rounded edges of furniture, which catch light, in metres."""
_BUMP_M, _BUMP = 0.004, 0.55
"""Distance in metres at which a pattern's brightness is compared, and how much a surface turns by it."""
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
_PLINTH, _PLINTH_SHARE = (0.42, 0.40, 0.38), 0.6
"""Colour that plinths take on, and how much of it: black ones look like gaps below the furniture."""
_SHADE = np.array((1.9, 1.5, 0.95))
"""Light (red, green, blue) of a lamp shade whose bulb is on."""
_FINER = {"wall_Stone_": 1.7, "wall_Brick_": 1.15}
"""Factors by which pictures show patterns smaller than simulations do, whose cameras have few pixels."""
_WALL_M, _INDOORS_M = 0.04, 0.11
"""Distances in metres: in front of a wall within its room, and outside rooms up to which things belong to walls."""
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
        self.names = [model.geom(index).name for index in range(model.ngeom)]
        plinths = [".plinth" in name for name in self.names]
        plain[plinths] += (np.array(_PLINTH) - plain[plinths]) * _PLINTH_SHARE
        self._plain = plain
        self._surfaces = [model.mat(index).name.removesuffix(LAID) for index in range(model.nmat)]
        self._materials = np.where(has_material, model.geom_matid, -1)
        half = model.geom_aabb[:, 3:].astype(float)
        shades = [self._is_shade(index) for index in range(model.ngeom)]
        self._shade = np.array(shades, np.bool_)
        self._wood = np.array([self._is_wood(index) for index in range(model.ngeom)], np.bool_)
        self._sharp = (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX) & ~has_material
        self._half = half
        self._cloth = np.array([is_cloth(name) for name in self.names], np.bool_)
        self._panel = self._sharp & [is_panelled(*each) for each in zip(self.names, half, strict=True)]
        self._print = np.array([bool(re.search(r"^picture_.*_(above|below)$", name)) for name in self.names], np.bool_)
        self._rooms = [
            (room_rects(room), surface_name("wall", room)) for room in world.floorplan.rooms if not room.is_outdoor
        ]
        self._middle = model.geom_aabb[:, :3].astype(float)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._places, self._turns = data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()
        self._thresholds = [threshold(passage) for passage in world.floorplan.passages if has_joint(passage, world)]

    def lit_shades(self) -> list[tuple[Vector, Vector]]:
        """Returns the middles and half extents of lamp shades that do not hang from ceilings, in metres."""
        lamps = np.flatnonzero(self._shade & (self._materials < 0))
        middles = self._places[lamps] + np.einsum("nij,nj->ni", self._turns[lamps], self._middle[lamps])
        return [(tuple(at), tuple(half)) for at, half in zip(middles.tolist(), self._half[lamps].tolist(), strict=True)]

    def outdoors(self, hits: Hits) -> Flags:
        """Returns a mask of the places that are outside the building; rays without a hit are not."""
        x, y, _ = (hits.places + 0.02 * hits.normals).T
        outside = hits.geoms >= 0
        for rects, _ in self._rooms:
            for west, south, east, north in rects:
                outside &= (
                    (x < west - _INDOORS_M)
                    | (x > east + _INDOORS_M)
                    | (y < south - _INDOORS_M)
                    | (y > north + _INDOORS_M)
                )
        return outside

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
        """Returns the directions that surfaces have for light: edges are round, and patterns have bumps.

        They have length 1, shape (n, 3).
        """
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
        """Returns directions at places on boxes, as if the boxes had round edges; they have no fixed length."""
        geoms = hits.geoms
        turns, half = self._turns[geoms], self._half[geoms]
        inside = self._inside(hits)
        radius = np.minimum(_EDGE_M, 0.3 * half)
        over = np.clip((np.abs(inside) - (half - radius)) / radius, 0, 1)
        # Twice as deep in the middle of an edge: light changes there, as on a curve that is seen from afar.
        local = np.sign(inside) * over**1.5
        panelled = np.flatnonzero(self._panel[geoms])
        local[panelled] += 0.5 * panel(inside[panelled], half[panelled])[0]
        return np.einsum("nij,nj->ni", turns, local) + hits.normals * 0.35

    def _inside(self, hits: Hits) -> Array:
        """Returns places as seen from the middles of their geoms, along the geoms' own axes, in metres."""
        geoms = hits.geoms
        return np.einsum("nji,nj->ni", self._turns[geoms], hits.places - self._places[geoms]) - self._middle[geoms]

    def colors(self, hits: Hits) -> Array:
        """Returns the surface colours at ray hits; those of shining surfaces are negative."""
        known = np.maximum(hits.geoms, 0)
        colors = self._plain[known].astype(float)
        materials = np.where(hits.geoms >= 0, self._materials[known], -1)
        for index in np.unique(materials[materials >= 0]):
            name = self._surfaces[index]
            mine = np.flatnonzero(materials == index)
            if name.startswith("floor_"):
                colors[mine] = self._floor(name, hits[mine])
            elif name.startswith("wall_"):
                colors[mine] = self._wall(name, hits[mine])
        self._detail(colors, hits, np.where(hits.geoms >= 0, known, -1))
        shades = np.flatnonzero((hits.geoms >= 0) & self._shade[known])
        colors[shades] = -_SHADE * (0.9 + 0.1 * hits.normals[shades, 2:])  # brighter above, where the bulb is
        return colors

    def _detail(self, colors: Array, hits: Hits, geoms: Ids) -> None:
        """Draws grain, weave, panels and prints into `colors`, which is changed in place; geoms of -1 are left out."""
        known, there = np.maximum(geoms, 0), geoms >= 0
        wood, cloth, panelled, prints = (
            np.flatnonzero(there & kind[known]) for kind in (self._wood, self._cloth, self._panel, self._print)
        )
        colors[wood] *= self._worked(hits[wood])[:, None]
        colors[cloth] *= weave(hits.places[cloth])[:, None]
        colors[panelled] *= panel(self._inside(hits[panelled]), self._half[geoms[panelled]])[1][:, None]
        own = geoms[prints]
        colors[prints] = drawn(colors[prints], self._inside(hits[prints]), self._half[own], own.astype(float))

    def _wall(self, name: str, hits: Hits) -> Array:
        """Returns the colours of walls: those of the room before them, also at the ends of walls of other rooms."""
        x, y, _ = (hits.places + _WALL_M * hits.normals).T
        names = np.full(len(x), -1)
        for number, (rects, _) in enumerate(self._rooms):
            for west, south, east, north in rects:
                names[(x > west) & (x < east) & (y > south) & (y < north)] = number
        colors = np.zeros((len(x), 3))
        for number in np.unique(names):
            mine = np.flatnonzero(names == number)
            colors[mine] = _wall(self._rooms[number][1] if number >= 0 else name, hits[mine])
        return colors

    def _is_shade(self, number: int) -> bool:
        name, material = self.names[number], int(self._materials[number])
        part = name.removesuffix("_seen").partition(".")[2]
        return (material >= 0 and self._surfaces[material] == LAMP_SHADE) or part in ("shade", "lamp-shade")

    def _is_wood(self, number: int) -> bool:
        red, green, blue = self._plain[number]
        part = self.names[number].partition(".")[2]
        is_furniture = bool(part) and not any(word in part for word in _NO_WOOD)
        is_brown = _RED > red - green > _WARM and red - blue > _SATURATED and blue > _LEAST_BLUE * red
        return is_furniture and self._materials[number] < 0 and is_brown

    def _floor(self, name: str, hits: Hits) -> Array:
        x, y, _ = hits.places.T
        colors = sample(name, x, y) / 255.0
        for west, south, east, north in self._thresholds:
            on = (x > west) & (x < east) & (y > south) & (y < north)
            colors = np.where(on[:, None], np.array(THRESHOLD_COLOR), colors)
        return colors

    def _worked(self, hits: Hits) -> Array:
        """Returns the brightness of the grain at places: around 1 on wood, 1 elsewhere."""
        geoms = hits.geoms
        inside, half = self._inside(hits), self._half[geoms]
        order = np.argsort(-half, axis=1)
        along, across, through = (np.take_along_axis(inside, order[:, [axis]], 1)[:, 0] for axis in range(3))
        # Each board is cut from another place of the tree.
        shift = geoms * 7.31
        grain = noise(along * _GRAIN_PER_M[0] + shift, (across + through) * _GRAIN_PER_M[1] + shift * 3)
        rings = noise(along * 0.6 + shift, (across + 0.7 * through) * 9 + shift)
        return np.where(self._wood[geoms], 1 + _GRAIN * (0.55 * grain + 0.45 * rings - 0.5), 1.0)


def _bumpy(name: str, hits: Hits) -> Array:
    """Returns directions at places on a patterned surface, which slopes where its brightness changes.

    They have no fixed length.
    """
    x, y, z = hits.places.T
    upright = np.abs(hits.normals[:, 2]) < 0.5
    on_y = np.abs(hits.normals[:, 0]) > 0.5
    finer = _finer(name)
    u, v = finer * np.where(upright & on_y, y, x), finer * np.where(upright, z, y)
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
    finer = _finer(name)
    return sample(name, along * finer, z * finer) / 255.0


def _finer(name: str) -> float:
    return next((share for start, share in _FINER.items() if name.startswith(start)), 1.0)


def has_joint(passage: Passage, world: World) -> bool:
    """Whether two different floors meet in a passage."""
    rooms = {room.name: room for room in world.floorplan.rooms}
    one, other = (surface_name("floor", rooms[name]) for name in passage.rooms)
    return one != other


def threshold(passage: Passage) -> Box:
    """Returns the rectangle that a threshold covers, between the jambs of its passage."""
    return strip(passage.start, passage.end, THRESHOLD_M / 2)
