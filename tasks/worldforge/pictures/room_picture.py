"""Renders a picture from inside a room: its furniture and decoration, from a corner that shows them."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import io
from collections.abc import Iterator
from math import atan2, hypot

import mujoco
import numpy as np
from PIL import Image

from ....schemas.wire.request_problems import nearest_of
from ....schemas.worlds.world import Furniture, GazeboSource, Room, World, contains
from ..geometry.boxes import box_of, hits, room_rects
from ..geometry.parts import Vector
from ..materials.texture_files import texture_png
from ..materials.textures import SKY, texture_size_m
from ..model.mjcf import TEXTURES_FOLDER, decorated_mjcf, surfaces, world_mjcf
from .fine_forms import refined
from .ray_casting import Array, Camera, Flags
from .ray_picture import RayPicture
from .room_lights import room_lighting
from .room_looks import Looks

EYE_M = 1.45
"""Height of the camera above the floor, in metres: that of photographs of rooms."""

_FOV_DEG = 75.0
"""Angle of view from left to right, in degrees: that of a lens for rooms. Wider ones draw things out of shape."""
_DROP = 0.15
"""Distance of the picture's middle below the horizon, over its distance: one sees more of floors than of ceilings."""
_BEHIND_M = (0.55, 1.1, 1.7)
"""Distances in metres behind a wall at which a camera may stand that sees through it: rooms are small."""
_ALONG = (0.2, 0.4, 0.6, 0.8)
"""Places along a wall, as shares of its length, behind which a camera may stand."""
_WALL_COST = 0.1
"""Cost of a view through a wall, for each metre behind it: the camera stands in the room where it can."""
_WALL_HALF_M = 0.12
"""Distance from a room's outline, in metres, within which walls, curtains and skirtings are."""
_FROM_WALL_M = 0.28
_STEP_M, _MOST_STEPS = 0.8, 5
"""Distance between places where the camera might stand, in metres, and largest number of steps between two walls."""
_LOOK = (26, 16)
"""Numbers of rays, to the right and down, of a look from a place where the camera might stand."""
_TOLD_SHARE, _MAIN_SHARE = 0.012, 0.03
"""Shares of the picture from which one knows a piece of furniture, and one that makes a room what it is."""
_TOLD_FROM_M = 1.0
"""Least distance of furniture that one knows, in metres; nearer pieces are cut by the picture's edge."""
_NEAR_M, _BEFORE_EYES_M = 1.0, 0.5
_FOREGROUND_M, _RIM_M = 1.7, 2.4
"""Furniture that is nearer hides what lies behind it, and is too near to be cut by the picture's edge."""
_RIM_COST, _FOREGROUND_COST = 8.0, 6.0
"""Losses for a picture whose whole edge cuts things that are near, and for one that they fill."""
_BARE_SHARE = 0.5
"""Share of the picture above which walls and ceilings are bare: it shows nothing of the room."""
_WINDOW_SHARE = 0.1
"""Share of the picture above which windows take the place of the room."""
_BUILDING = ("wall_", "floor_", "ceiling_", "window_", "curtain_", "blind_", "skirting_", "doorframe_")
"""Beginnings of the names of what a room is made of: it may be near."""
_BESIDE_M, _BEFORE_SHARE = 2.2, 0.8
"""Distance in metres of tall things at the sides that is too near; share of the usual distance in the middle."""
_TALL_M, _BEFORE_M = 1.15, 2.6
"""Height and distance of furniture, such as a floor lamp, that stands before the eyes in the middle of a picture."""
_CUT = 3.5
"""Loss of what a piece tells, for each share of it that lies at the picture's edge."""
_FILLS_SHARE = 0.16
"""Share of the picture above which one piece of furniture hides the rest."""
_EDGE_ON = 0.25
"""Sine of the angle along an open door below which one sees its edge only."""
_FAR_M = 7.0
_FLOOR_SHARE = 0.26
"""Share of floor that a picture should have: things are seen to stand on it."""

_MAIN = {
    "Bathroom": ("Baths", "Showers", "Toilets", "VanityCounters"),
    "Bedroom": ("Beds",),
    "Dining": ("DiningTables",),
    "Kitchen": ("Fridges", "KitchenIslandsAndCarts", "Ovens", "Storage"),
    "Living": ("CoffeeTables", "MediaStorage", "Sofas"),
    "Office": ("Desks",),
}
"""Furniture that makes a room what it is: a picture of the room shows it."""
_MAIN_WEIGHT = 5.0


def room_picture(world: World, room: str, width_px: int = 960, height_px: int = 600) -> bytes:
    """Renders a picture of the inside of a room.

    Args:
        world: The world.
        room: The room's name.
        width_px: Width of the picture.
        height_px: Height of the picture.

    Returns:
        A PNG; the same one for the same world.

    Raises:
        ValueError: The world has no room of this name.
    """
    found = next((each for each in world.floorplan.rooms if each.name == room), None)
    if found is None:
        names = [each.name for each in world.floorplan.rooms]
        raise ValueError(f"room {room!r}: the world has none of this name{nearest_of(room, names, 'its rooms are')}")
    model = decorated_model(world)
    looks = Looks(model, world)
    picture = RayPicture(model, looks.colors, bend=looks.bent)
    lighting = room_lighting(picture, looks, world, found)
    pixels = picture.draw(best_camera(picture, looks.names, world, found), lighting, width_px, height_px)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", compress_level=6)
    return buffer.getvalue()


def decorated_model(world: World) -> mujoco.MjModel:
    """Compiles a world as its bundle has it: those from Gazebo have no decoration of ours."""
    if isinstance(world.source, GazeboSource):
        return mujoco.MjModel.from_xml_string(world_mjcf(world))
    text, meshes = decorated_mjcf(world)
    pictured = [*(name for name in surfaces(world) if texture_size_m(name) is not None), SKY]
    files = {name: content.encode() for name, content in meshes.items()}
    files |= {f"{TEXTURES_FOLDER}/{name}.png": texture_png(name) for name in pictured}
    return mujoco.MjModel.from_xml_string(refined(text), files)


def best_camera(picture: RayPicture, names: list[str], world: World, room: Room) -> Camera:
    """Chooses the camera in a room that shows most of the room's own furniture.

    Args:
        picture: The world.
        names: Names of its geoms.
        world: The same.
        room: The room.
    """
    pieces = [item for item in world.furniture if item.room == room.name]
    view = _View(picture, names, room, pieces)
    best, best_score = Camera((room.goal[0], room.goal[1], EYE_M), 0.0, 0.0, _FOV_DEG, _DROP), -np.inf
    for camera, cost in _cameras(room, pieces):
        score = view.score(camera) - cost
        if score > best_score + 1e-9:
            best, best_score = camera, score
    return best


def _cameras(room: Room, pieces: list[Furniture]) -> Iterator[tuple[Camera, float]]:
    """Yields cameras in a room and behind its walls, each with what its place costs."""
    targets = list(_targets(room, pieces))
    for x, y in _spots(room, pieces):
        for toward in targets:
            if hypot(toward[0] - x, toward[1] - y) >= _BEFORE_EYES_M:
                yield _camera((x, y), toward, None), 0.0
    for (x, y), (nx, ny) in _wall_spots(room):
        front = ((x, y, EYE_M), (nx, ny, 0.0))
        for behind in _BEHIND_M:
            eye = (x - behind * nx, y - behind * ny)
            straight = (x + nx, y + ny)
            for toward in (straight, *targets):
                yield _camera(eye, toward, front), _WALL_COST * behind


def _camera(eye: tuple[float, float], toward: tuple[float, float], front: tuple[Vector, Vector] | None) -> Camera:
    yaw = round(atan2(toward[1] - eye[1], toward[0] - eye[0]), 4)
    return Camera((*eye, EYE_M), yaw, 0.0, _FOV_DEG, _DROP, front)


class _View:
    """Judges what cameras would see of a room.

    Args:
        picture: The world.
        names: Names of its geoms.
        room: The room.
        pieces: Furniture and loose objects in it.
    """

    def __init__(self, picture: RayPicture, names: list[str], room: Room, pieces: list[Furniture]) -> None:
        self._picture, self._room = picture, room
        numbers = {item.id: number for number, item in enumerate(pieces)}
        self._piece = np.array([numbers.get(name.partition(".")[0], -1) for name in names])
        self._floor = np.array([name.startswith(("floor_", "rug_")) for name in names])
        self._bare = np.array([name.startswith(("wall_", "ceiling_")) for name in names])
        self._thing = np.array([not name.startswith((*_BUILDING, "rug_")) for name in names])
        self._door = np.array([name.startswith("door-") for name in names])
        main = _MAIN.get(room.type, ())
        self._enough = np.array([_MAIN_SHARE if item.model_type in main else _TOLD_SHARE for item in pieces])
        weights = [0.15 if item.movable else _MAIN_WEIGHT if item.model_type in main else 1.0 for item in pieces]
        self._weights = np.array(weights)
        rows, columns = (axis.ravel() for axis in np.indices((_LOOK[1], _LOOK[0])))
        self._rim = (columns == 0) | (columns == _LOOK[0] - 1) | (rows == _LOOK[1] - 1)
        self._center = np.abs(columns + 0.5 - _LOOK[0] / 2) < _LOOK[0] / 3
        self._rows, self._columns = (axis.ravel().astype(float) for axis in np.mgrid[0 : _LOOK[1], 0 : _LOOK[0]])

    def score(self, camera: Camera) -> float:
        """Returns how good a camera's view is; the higher, the better."""
        rays = camera.rays(*_LOOK, self._columns, self._rows)
        with self._picture.before(camera):
            geoms, distances, normals = self._picture.trace(camera.place, rays)
        places = np.array(camera.place) + rays * np.maximum(distances, 0)[:, None]
        # What lies between a camera behind a wall and that wall is not in the picture.
        ahead = distances - _to_front(camera, rays)
        known, met = np.maximum(geoms, 0), geoms >= 0
        telling = met & (self._piece[known] >= 0) & (ahead > _TOLD_FROM_M)
        shares = np.bincount(self._piece[known][telling], minlength=len(self._weights)) / len(rays)
        # Of what the picture's edge cuts one sees too little.
        cut = np.bincount(self._piece[known][telling & self._rim], minlength=len(self._weights)) / len(rays)
        told = np.minimum(shares / self._enough, 1) * np.clip(1.15 - _CUT * cut / np.maximum(shares, 1e-6), 0.3, 1)
        own = self._inside(places) & met
        seen = np.where(met, np.minimum(distances, _FAR_M), 0.0)
        score = 4.0 * float(told @ self._weights) / max(float(self._weights.sum()), 1.0)
        score += 3.0 * float(own.mean()) + 0.3 * float(np.sqrt(seen).mean())
        score += 3.5 * min(float((self._floor[known] & met).mean()), _FLOOR_SHARE)
        door = self._door[known] & met
        edge_on = door & (np.abs(np.sum(rays * normals, axis=1)) < _EDGE_ON)
        score -= 2.0 * float(door.mean()) + 6.0 * float(edge_on.mean())
        score -= 2.0 * max(float((~met).mean()) - _WINDOW_SHARE, 0.0)
        score -= 3.0 * max(float((self._bare[known] & met).mean()) - _BARE_SHARE, 0.0)
        every = np.bincount(self._piece[known][met & (self._piece[known] >= 0)], minlength=len(self._weights))
        score -= 3.0 * float(np.clip(every / len(rays) - _FILLS_SHARE, 0, None).sum())
        things = met & self._thing[known]
        score -= _FOREGROUND_COST * float((things & (ahead < _FOREGROUND_M)).mean())
        score -= _RIM_COST * float((things & (ahead < _RIM_M))[self._rim].mean())
        tall = things & (places[:, 2] > _TALL_M)
        before = max(_BEFORE_M, _BEFORE_SHARE * float(np.median(seen)))
        score -= 30.0 * float((tall & (ahead < np.where(self._center, before, _BESIDE_M))).mean())
        near = met & (ahead < _NEAR_M)
        return score - 3.0 * float(near.mean()) - 8.0 * float((near & (ahead < _BEFORE_EYES_M)).mean())

    def _inside(self, places: Array) -> Flags:
        """Returns a mask of the places that are in the room or on its walls."""
        inside = np.zeros(len(places), np.bool_)
        for x0, y0, x1, y1 in room_rects(self._room):
            inside |= (places[:, 0] >= x0) & (places[:, 0] <= x1) & (places[:, 1] >= y0) & (places[:, 1] <= y1)
        return inside


def _to_front(camera: Camera, rays: Array) -> Array:
    """Returns the distance along rays to the plane from which a camera sees, in metres; 0 for a camera without one."""
    if camera.front is None:
        return np.zeros(len(rays))
    place, normal = (np.array(each) for each in camera.front)
    return float((place - np.array(camera.place)) @ normal) / np.maximum(rays @ normal, 0.05)


def _wall_spots(room: Room) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Yields places on the walls of a room's parts, each with the direction into the room.

    Places are x and y in metres, a little inside; directions are unit vectors.
    """
    for x0, y0, x1, y1 in room_rects(room):
        for share in _ALONG:
            x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
            for place, into in (((x, y0), (0.0, 1.0)), ((x, y1), (0.0, -1.0)),
                                ((x0, y), (1.0, 0.0)), ((x1, y), (-1.0, 0.0))):  # fmt: skip
                spot = (place[0] + _WALL_HALF_M * into[0], place[1] + _WALL_HALF_M * into[1])
                if not contains(room.polygon, spot[0] - 0.5 * into[0], spot[1] - 0.5 * into[1]):
                    yield spot, into


def _targets(room: Room, pieces: list[Furniture]) -> Iterator[tuple[float, float]]:
    """Yields places that a camera may look at: the room's middle, where robots go, and its furniture's."""
    yield _middle(room)
    yield room.goal
    main = [item for item in pieces if item.model_type in _MAIN.get(room.type, ())]
    for chosen in (main, [item for item in pieces if not item.movable]):
        if chosen:
            yield sum(item.x for item in chosen) / len(chosen), sum(item.y for item in chosen) / len(chosen)


def _spots(room: Room, pieces: list[Furniture]) -> list[tuple[float, float]]:
    """Returns places along the walls and across a room where a photographer could stand; x and y in metres.

    If furniture is on all of them, it returns them as if it were empty.
    """
    spots: list[tuple[float, float]] = []
    for x0, y0, x1, y1 in room_rects(room):
        xs, ys = (_steps(low + _FROM_WALL_M, high - _FROM_WALL_M) for low, high in ((x0, x1), (y0, y1)))
        spots += [(x, y) for x in xs for y in ys]
    inside = [spot for spot in spots if contains(room.polygon, *spot)]
    standing = [box_of(item) for item in pieces if not item.movable]
    free = [(x, y) for x, y in inside if not hits((x - 0.1, y - 0.1, x + 0.1, y + 0.1), standing)]
    return free or inside


def _steps(low: float, high: float) -> list[float]:
    """Returns equally spaced places between two ends, both of them included."""
    count = min(_MOST_STEPS, max(1, round((high - low) / _STEP_M)))
    return [low + (high - low) * index / count for index in range(count + 1)]


def _middle(room: Room) -> tuple[float, float]:
    rects = room_rects(room)
    areas = [(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in rects]
    x = sum(area * (x0 + x1) / 2 for area, (x0, _, x1, _) in zip(areas, rects, strict=True)) / sum(areas)
    y = sum(area * (y0 + y1) / 2 for area, (_, y0, _, y1) in zip(areas, rects, strict=True)) / sum(areas)
    return x, y
