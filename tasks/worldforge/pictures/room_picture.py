"""Renders a picture from inside a room, at eye height in a corner."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import io
from math import atan2, hypot
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ....schemas.worlds.world import Room, Window, World, contains
from ..interiors.placement import room_rects
from ..materials.materials import surface_finish
from ..materials.textures import sample
from ..model.mjcf import WINDOW_HEAD_M, WINDOW_SILL_M, world_mjcf
from .ray_picture import Camera, Hits, Lamp, RayPicture

EYE_M = 1.6
"""Height of the camera above the floor, in metres: of a person's eyes."""

FOV_DEG = 88.0
"""Horizontal field of view of a room's picture, in degrees."""

_PITCH = -0.2
_FROM_WALL_M = 0.28
_SKIRTING_M = 0.075
_SUN_COLOR = np.array([1.5, 1.36, 1.1])

Array = NDArray[np.floating[Any]]


def room_picture(world: World, room: str, width_px: int = 960, height_px: int = 600) -> bytes:
    """Renders a picture of the inside of a room.

    Args:
        world: the world.
        room: the room's name.
        width_px: width of the picture.
        height_px: height of the picture.

    Returns:
        A PNG; the same one for the same world.

    Raises:
        ValueError: the world has no room of this name.
    """
    found = next((each for each in world.floorplan.rooms if each.name == room), None)
    if found is None:
        names = ", ".join(each.name for each in world.floorplan.rooms)
        raise ValueError(f"room {room!r}: the world has none of this name; one of {names} would be right")
    model = mujoco.MjModel.from_xml_string(world_mjcf(world))
    picture = RayPicture(model, _Looks(model, world).colors)
    sun = _Sun(model, found, world)
    pixels = picture.draw(
        best_camera(picture, found), _lamps(world, found), width_px, height_px, ambient=0.24, extra=sun.light
    )
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", compress_level=6)
    return buffer.getvalue()


def best_camera(picture: RayPicture, room: Room) -> Camera:
    """Chooses the camera position in a room's corner that shows most of the room."""
    best, best_score = Camera((room.goal[0], room.goal[1], EYE_M), 0.0, _PITCH, FOV_DEG), -np.inf
    rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:20, 0:32])
    for x, y in _corners(room):
        for toward in (_middle(room), room.goal):
            yaw = round(atan2(toward[1] - y, toward[0] - x), 4)
            camera = Camera((x, y, EYE_M), yaw, _PITCH, FOV_DEG)
            _, distances, _ = picture.trace(camera.place, camera.rays(32, 20, columns, rows))
            seen = np.where(distances < 0, 0.0, np.minimum(distances, 7.0))
            score = float(np.sqrt(seen).mean() - 2.5 * (seen < 0.7).mean() - 6.0 * (seen < 0.35).mean())
            score -= picture.glass_share(camera, 32, 20)
            if score > best_score + 1e-9:
                best, best_score = camera, score
    return best


def _corners(room: Room) -> list[tuple[float, float]]:
    spots: list[tuple[float, float]] = []
    for x0, y0, x1, y1 in room_rects(room):
        low_x, high_x, low_y, high_y = x0 + _FROM_WALL_M, x1 - _FROM_WALL_M, y0 + _FROM_WALL_M, y1 - _FROM_WALL_M
        spots += [(x, y) for x in (low_x, high_x) for y in (low_y, high_y)]
        spots += [((low_x + high_x) / 2, y) for y in (low_y, high_y)]
        spots += [(x, (low_y + high_y) / 2) for x in (low_x, high_x)]
    return [spot for spot in spots if contains(room.polygon, *spot)]


def _middle(room: Room) -> tuple[float, float]:
    rects = room_rects(room)
    areas = [(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in rects]
    x = sum(area * (x0 + x1) / 2 for area, (x0, _, x1, _) in zip(areas, rects, strict=True)) / sum(areas)
    y = sum(area * (y0 + y1) / 2 for area, (_, y0, _, y1) in zip(areas, rects, strict=True)) / sum(areas)
    return x, y


def _inward(window: Window, room: Room) -> tuple[float, float]:
    """Returns the unit vector from a window into its room."""
    x, y = (window.start[0] + window.end[0]) / 2, (window.start[1] + window.end[1]) / 2
    if abs(window.end[0] - window.start[0]) > abs(window.end[1] - window.start[1]):
        return (0.0, 1.0) if contains(room.polygon, x, y + 0.3) else (0.0, -1.0)
    return (1.0, 0.0) if contains(room.polygon, x + 0.3, y) else (-1.0, 0.0)


def _lamps(world: World, room: Room) -> list[list[Lamp]]:
    """Makes the light sources of a room: ceiling lamps, windows, and light reflected by walls."""
    top = world.floorplan.ceiling_height_m
    x, y = _middle(room)
    rng = np.random.default_rng(5)
    spots = [(x + a, y + b) for a, b in rng.uniform(-0.35, 0.35, (16, 2))]
    warm = (1.0, 0.93, 0.82)
    windows = [window for window in world.floorplan.windows if window.room == room.name]
    power = 1.35 if windows else 1.9
    sets = [[Lamp((a, b, top - 0.35), 1.5 * power * _size(room), warm, (0.0, 0.0, -1.0)) for a, b in spots]]
    sets += [
        [_window_lamp(window, room, share, z) for share in (0.2, 0.4, 0.6, 0.8) for z in (1.1, 1.4, 1.7, 2.0)]
        for window in windows[:2]
    ]
    rects = room_rects(room)
    bounce: list[Lamp] = []
    for index in range(16):
        x0, y0, x1, y1 = rects[index % len(rects)]
        a, b, c = rng.random(3)
        spot = (x0 + 0.25 + a * (x1 - x0 - 0.5), y0 + 0.25 + b * (y1 - y0 - 0.5), 1.5 + c * (top - 1.7))
        bounce.append(Lamp(spot, 0.62 * _size(room), (1.0, 0.98, 0.95)))
    ways = [passage.rooms for passage in world.floorplan.passages if room.name in passage.rooms]
    others = [
        other for other in world.floorplan.rooms if other.name != room.name and any(other.name in way for way in ways)
    ]
    sets.append(bounce)
    sets += [[Lamp((*_middle(other), top - 0.3), 1.3 * _size(other), warm)] for other in others]
    return sets


def _size(room: Room) -> float:
    """Returns the brightness factor for a room's lamps: larger rooms have brighter ones."""
    return 0.45 + 0.045 * room.area_m2


def _window_lamp(window: Window, room: Room, share: float, z: float) -> Lamp:
    inward = _inward(window, room)
    x = window.start[0] + share * (window.end[0] - window.start[0]) + 0.2 * inward[0]
    y = window.start[1] + share * (window.end[1] - window.start[1]) + 0.2 * inward[1]
    width = hypot(window.end[0] - window.start[0], window.end[1] - window.start[1])
    return Lamp((x, y, z), 1.6 * width, (0.9, 0.97, 1.08), (*inward, 0.0))


class _Looks:
    """Colours of a world's geoms and surfaces.

    Args:
        model: the compiled world, whose materials are named like surfaces.
        world: the world.
    """

    def __init__(self, model: mujoco.MjModel, world: World) -> None:
        material = np.maximum(model.geom_matid, 0)
        self._plain = np.where((model.geom_matid >= 0)[:, None], model.mat_rgba[material], model.geom_rgba)[:, :3]
        self._names = [model.mat(index).name for index in range(model.nmat)]
        self._materials = model.geom_matid
        names = [model.geom(index).name for index in range(model.ngeom)]
        self._glass = np.array([name.startswith("window_") and name.endswith("_glass") for name in names])
        self._shade = np.array([name.endswith("shade") for name in names])
        self._head = min(WINDOW_HEAD_M, world.floorplan.ceiling_height_m - 0.2)

    def colors(self, hits: Hits) -> Array:
        """Returns the surface colours at ray hits; those of shining surfaces are negative."""
        colors = self._plain[np.maximum(hits.geoms, 0)].astype(float)
        materials = np.where(hits.geoms >= 0, self._materials[np.maximum(hits.geoms, 0)], -1)
        for index in np.unique(materials[materials >= 0]):
            mine = np.flatnonzero(materials == index)
            colors[mine] = _surface_colors(self._names[index], hits[mine])
        shades = np.flatnonzero((hits.geoms >= 0) & self._shade[np.maximum(hits.geoms, 0)])
        colors[shades] = -colors[shades] * (0.97 + 0.06 * hits.normals[shades, 2:])
        panes = np.flatnonzero((hits.geoms >= 0) & self._glass[np.maximum(hits.geoms, 0)])
        colors[panes] = -self._sky(hits.places[panes])
        return colors

    def _sky(self, places: Array) -> Array:
        """Returns the colours of the view from a window: sky, and far trees at its foot, behind a crossbar."""
        up = np.clip((places[:, 2:] - WINDOW_SILL_M) / (self._head - WINDOW_SILL_M), 0, 1)
        along = places[:, :1] + places[:, 1:2]
        sky = np.array([0.93, 0.96, 0.97]) * (1 - up) + np.array([0.7, 0.83, 0.94]) * up
        trees = 0.2 + 0.05 * np.sin(along * 5.1) + 0.035 * np.sin(along * 13.7 + 1) + 0.02 * np.sin(along * 31)
        color = np.where(up < trees, np.array([0.62, 0.72, 0.58]) * (0.9 + 0.6 * up), sky)
        return np.where(np.abs(up - 0.62) < 0.022, np.array([0.9, 0.9, 0.88]), color)


def _surface_colors(name: str, hits: Hits) -> Array:
    """Returns the colours at points of a floor or a wall, with a skirting board at the foot of most walls."""
    x, y, z = hits.places.T
    if name.startswith("floor_"):
        return sample(name, x, y) / 255.0
    along = np.where(np.abs(hits.normals[:, 0]) > 0.5, y, x)
    colors = sample(name, along, z) / 255.0
    if surface_finish(name).pattern in ("plain", "stripes", "trellis", "sprigs", "panels"):
        foot = z < _SKIRTING_M
        colors = np.where(
            foot[:, None], np.array([0.95, 0.94, 0.92]) * (1 - 0.12 * (z > _SKIRTING_M - 0.012))[:, None], colors
        )
    return colors


class _Sun:
    """Sunlight that falls through a room's windows onto its furniture.

    Args:
        model: the compiled world.
        room: the room.
        world: the world.
    """

    def __init__(self, model: mujoco.MjModel, room: Room, world: World) -> None:
        self._model = model
        self._head = min(WINDOW_HEAD_M, world.floorplan.ceiling_height_m - 0.2)
        self._room = room
        self._windows = [window for window in world.floorplan.windows if window.room == room.name]
        names = [model.geom(index).name for index in range(model.ngeom)]
        self._building = np.array([name.split("_")[0] in ("wall", "ceiling", "window", "floor") for name in names])

    def light(self, picture: RayPicture, hits: Hits) -> Array:
        """Returns the sunlight at points, shape (n, 3)."""
        light = np.zeros((len(hits.geoms), 3))
        for window in self._windows:
            inward = _inward(window, self._room)
            # It shines obliquely through every window: a home has no north side in its pictures.
            across = (-inward[1], inward[0])
            toward = np.array([-inward[0] * 0.72 + across[0] * 0.4, -inward[1] * 0.72 + across[1] * 0.4, 0.62])
            toward /= np.linalg.norm(toward)
            light += self._through(picture, window, inward, toward, hits)
        return light

    def _through(
        self, picture: RayPicture, window: Window, inward: tuple[float, float], toward: Array, hits: Hits
    ) -> Array:
        light = np.zeros((len(hits.geoms), 3))
        facing = hits.normals @ toward
        normal = np.array([*inward, 0.0])
        start = np.array([*window.start, 0.0])
        away = ((start - hits.places) @ normal) / (toward @ normal)
        crossing = hits.places + toward * away[:, None]
        span = np.array([*window.end, 0.0]) - start
        along = ((crossing - start) @ span) / (span @ span)
        length = float(np.linalg.norm(span))
        up = (crossing[:, 2] - WINDOW_SILL_M) / (self._head - WINDOW_SILL_M)
        rim = 0.07 / length
        open_pane = (along > rim) & (along < 1 - rim) & (up > 0.06) & (up < 0.94) & (np.abs(up - 0.62) > 0.03)
        candidates = np.flatnonzero(open_pane & (facing > 0) & (away > 0.05) & (hits.geoms >= 0))
        if len(candidates) == 0:
            return light
        far = (start + span / 2) + toward * 40.0
        ways = hits.places[candidates] + hits.normals[candidates] * 0.004 - far
        distances = np.linalg.norm(ways, axis=1)
        groups = self._model.geom_group.copy()
        try:
            self._model.geom_group[self._building] = 3
            _, met, _ = picture.trace((far[0], far[1], far[2]), ways / distances[:, None])
        finally:
            self._model.geom_group[:] = groups
        free = candidates[(met < 0) | (met > distances - 0.015)]
        light[free] = facing[free, None] * _SUN_COLOR
        return light
