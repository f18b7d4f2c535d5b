"""Light in a room by day: sky through windows, the sun, ceiling lamps, and what all of these light in turn."""

from collections.abc import Sequence
from math import cos, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import Room, Window, World, contains
from ..decor.faces import window_heights
from ..decor.lights_and_ceilings import lamp_spots
from ..geometry.parts import Vector
from .outside import outside
from .ray_casting import Array, Flags, Hits, RayCaster
from .ray_light import SUNS, Lamp, Lighting
from .ray_picture import GAMMA, Look
from .room_looks import Looks

_PER_SET = 16
"""Number of lamps of a set: as many as there are pixels in a square that shares what it saw."""

_SKY_POWER = 2.6
"""Light of a window a metre wide, as `Lamp.power` counts it."""
_SKY_COLOR = (0.94, 0.98, 1.05)
_LAMP_POWER, _LAMP_ONLY_POWER = 0.7, 1.6
"""Light of a ceiling lamp by day, and of one that no window helps."""
_LAMP_COLOR = (1.0, 0.86, 0.66)
_STANDING_POWER, _STANDING_COLOR = 1.3, (1.0, 0.72, 0.42)
"""Light of a lamp of 0.4 m that stands on the floor, and its colour: evening comes into the day."""
_STANDING_M = 0.02
"""Distance in metres of such a lamp's light from its shade, which would hide it."""
_LAMP_M, _BELOW_CEILING_M = 0.17, 0.15
"""Radius of a lamp and its distance from the ceiling, under its shade, in metres."""
_SUN_POWER = 4.4
"""Light of the sun on a white sheet that faces it."""
_SUN_COLOR = np.array((1.0, 0.89, 0.71))
_SUN_RISE = 0.5
"""Tangent of the sun's height: its patches lie in the half of the room that is near the window."""
_BLUR, _BLUR_LOOKS = 0.008, 6
"""Radius of points outside that are out of focus, over their distance, and number of directions that are averaged."""
_SUN_FAR_M = 60.0
_SUN_RADIUS = 0.013
"""Radius of the sun, as one sees it through thin clouds, over its distance: edges of its patches are soft."""
_AMBIENT = 0.06
"""Light that was thrown back more than once."""
_AGAIN_SETS = 3
"""Number of sets of lamps for light that was thrown back twice."""
_SHADED_M = 0.55
"""Distance in metres up to which things take light from each other: a table from the floor below it."""
_INTO_ROOM_M = 0.2
_SLACK_M = 0.15
_SEED = 5


class Opening(NamedTuple):
    """A window that lights a room."""

    start: Array
    """Position of one end of the window at its sill, in metres."""
    along: Array
    """Vector from the start of the window to its other end, in metres."""
    up_m: float
    inward: Array
    """Unit vector, across the wall, into the room."""

    @property
    def wide_m(self) -> float:
        """Width of the window in metres."""
        return float(np.linalg.norm(self.along))


def room_lighting(caster: RayCaster, looks: Looks, world: World, room: Room) -> Lighting:
    """Makes the light of a room by day.

    Args:
        caster: Tells what light falls on.
        looks: Tell of what colour that is.
        world: The world.
        room: The room that the picture shows; those beyond its doors and openings are lit as well.
    """
    further = _neighbours(world, room)
    openings = _openings(world, room)
    beyond = [opening for other in further for opening in _openings(world, other)]
    sky = [*map(_window_lamps, openings), *_one_set([_window_lamps(opening) for opening in beyond])]
    power = _LAMP_POWER if openings or beyond else _LAMP_ONLY_POWER
    lamps = _ceiling_lamps(world, [room], power)
    lamps += _one_set(_ceiling_lamps(world, further, power))
    lamps += _one_set([_standing(*shade) for shade in looks.lit_shades() if contains(room.polygon, *shade[0][:2])])
    sun = Sun(caster, [*openings, *beyond])
    rng = np.random.default_rng(_SEED)
    thrown = [_thrown_back(caster, looks.colors, group, _spread(group, rng)) for group in (*sky, *lamps)]
    thrown += [_thrown_back(caster, looks.colors, patches, sun.rays) for patches in _one_set(sun.patches(rng))]
    # Light that was thrown back twice fills what neither windows nor lamps see.
    again = [_thrown_back(caster, looks.colors, group, _spread(group, rng)) for group in thrown if group]
    thrown += _one_set([group for group in again if group], _AGAIN_SETS)
    return Lighting(
        lamps=[*sky, *lamps, *(group for group in thrown if group)],
        ambient=(_AMBIENT, _AMBIENT, _AMBIENT),
        sun=sun.light if sun.openings else None,
        toward_sun=_vector(sun.toward),
        outside=_out_of_focus,
        outdoors=looks.outdoors,
        shaded_m=_SHADED_M,
        exposed=True,
        gloss=looks.gloss(),
    )


def _out_of_focus(rays: Array) -> Array:
    """Returns the light from outside in directions, shape (n, 3), as a lens shows it that is set on the room."""
    light = np.zeros((len(rays), 3))
    aside = np.stack([rays[:, 1], -rays[:, 0], np.zeros(len(rays))], axis=1)
    for number in range(_BLUR_LOOKS):
        out, turn = _BLUR * sqrt((number + 0.5) / _BLUR_LOOKS), number * 2.399963
        moved = rays + out * cos(turn) * aside
        moved[:, 2] += out * sin(turn)
        light += outside(moved) ** GAMMA
    return light / _BLUR_LOOKS


def _neighbours(world: World, room: Room) -> list[Room]:
    """Returns the rooms that one sees through a room's doors and openings, without the room itself."""
    ways = [passage.rooms for passage in world.floorplan.passages if room.name in passage.rooms]
    return [other for other in world.floorplan.rooms if other != room and any(other.name in way for way in ways)]


def _openings(world: World, room: Room) -> list[Opening]:
    sill, head = window_heights(world)
    return [
        Opening(
            np.array([*window.start, sill]),
            np.array([window.end[0] - window.start[0], window.end[1] - window.start[1], 0.0]),
            head - sill,
            _inward(window, room),
        )
        for window in world.floorplan.windows
        if window.room == room.name
    ]


def _inward(window: Window, room: Room) -> Array:
    """Returns the unit vector, across its wall, from a window into its room."""
    x, y = (window.start[0] + window.end[0]) / 2, (window.start[1] + window.end[1]) / 2
    if abs(window.end[0] - window.start[0]) > abs(window.end[1] - window.start[1]):
        return np.array((0.0, 1.0 if contains(room.polygon, x, y + 0.3) else -1.0, 0.0))
    return np.array((1.0 if contains(room.polygon, x + 0.3, y) else -1.0, 0.0, 0.0))


def _window_lamps(opening: Opening) -> list[Lamp]:
    """Makes lamps all over a window that shine into the room like the sky outside."""
    facing = (float(opening.inward[0]), float(opening.inward[1]), 0.0)
    lamps: list[Lamp] = []
    for share in (0.125, 0.375, 0.625, 0.875):
        for up in (0.15, 0.4, 0.65, 0.9):
            x, y, z = opening.start + share * opening.along + _INTO_ROOM_M * opening.inward
            place = (float(x), float(y), float(z) + up * opening.up_m)
            lamps.append(Lamp(place, _SKY_POWER * opening.wide_m, _SKY_COLOR, facing))
    return lamps


def _ceiling_lamps(world: World, rooms: Sequence[Room], power: float) -> list[list[Lamp]]:
    """Makes a set of lamps all over each ceiling lamp of rooms; a room that has none gets one in its middle."""
    z = world.floorplan.ceiling_height_m - _BELOW_CEILING_M
    known = lamp_spots(world)
    sets: list[list[Lamp]] = []
    for room in rooms:
        spots = [(x, y) for x, y, _ in known if contains(room.polygon, x, y)] or [room.goal]
        for x, y in spots:
            bright = power * (0.45 + 0.045 * room.area_m2) / len(spots)  # larger rooms have brighter lamps
            disc = [(_LAMP_M * sqrt((n + 0.5) / _PER_SET), n * 2.399963) for n in range(_PER_SET)]
            sets.append(
                [
                    Lamp((x + out * cos(turn), y + out * sin(turn), z), bright, _LAMP_COLOR, (0.0, 0.0, -1.0))
                    for out, turn in disc
                ]
            )
    return sets


def _standing(middle: Vector, half: Vector) -> list[Lamp]:
    """Makes lamps all around a shade, above and below it: those within would light the shade alone."""
    (x, y, z), (wide, _, tall) = middle, half
    power = _STANDING_POWER * min(1.0, wide / 0.2)
    made: list[Lamp] = []
    for number in range(_PER_SET):
        turn = number * 2.399963
        if number % 2:
            away = (cos(turn), sin(turn), 0.0)
            place = (x + (wide + _STANDING_M) * away[0], y + (wide + _STANDING_M) * away[1], z)
        else:
            away = (0.0, 0.0, 1.0 if number % 4 else -1.0)
            out = wide / 2
            place = (x + out * cos(turn), y + out * sin(turn), z + (tall + _STANDING_M) * away[2])
        made.append(Lamp(place, power, _STANDING_COLOR, away))
    return made


def _one_set(sets: Sequence[list[Lamp]], count: int = 1) -> list[list[Lamp]]:
    """Returns sets of lamps merged into one, or into `count`, that give as much light; empty for no sets."""
    if not sets:
        return []
    # One of each set in turn, and from different parts of them.
    most = _PER_SET * count
    chosen = [sets[n % len(sets)][(n * 5 + n // _PER_SET) % len(sets[n % len(sets)])] for n in range(most)]
    share = len(sets) / count
    made = [Lamp(lamp.place, lamp.power * share, lamp.color, lamp.facing) for lamp in chosen]
    return [made[first::count] for first in range(count)]


def _spread(lamps: Sequence[Lamp], rng: np.random.Generator) -> Array:
    """Returns a random direction for each lamp, as light leaves a white sheet: more straight ahead than aside."""
    ahead = np.array([lamp.facing for lamp in lamps])
    aside = np.where(np.abs(ahead[:, 2:]) > 0.5, np.array((1.0, 0.0, 0.0)), np.array((0.0, 0.0, 1.0)))
    first = np.cross(ahead, aside)
    second = np.cross(ahead, first)
    square, turn = rng.random((2, len(lamps)))
    out, turn = np.sqrt(square)[:, None], (2 * pi * turn)[:, None]
    return ahead * np.sqrt(1 - out**2) + out * (np.cos(turn) * first + np.sin(turn) * second)


def _thrown_back(caster: RayCaster, look: Look, lamps: Sequence[Lamp], rays: Array) -> list[Lamp]:
    """Makes lamps where the light of others falls first, in the colour of what it falls on.

    Those whose light leaves through a window make none; the others' power is lowered to fit.
    """
    made: list[Lamp] = []
    for lamp, ray in zip(lamps, np.broadcast_to(rays, (len(lamps), 3)), strict=True):
        hit = caster.hits(lamp.place, ray[None])
        if hit.geoms[0] < 0:
            continue
        color = np.abs(look(hit)[0]) ** GAMMA * np.array(lamp.color)
        place = hit.places[0] + 0.02 * hit.normals[0]
        made.append(Lamp(_vector(place), lamp.power, _vector(color), _vector(hit.normals[0])))
    # A set's light is its lamps' mean: those that are missing, as their light went out of a window, are none.
    return [Lamp(lamp.place, lamp.power * len(made) / len(lamps), lamp.color, lamp.facing) for lamp in made]


def _vector(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


class Sun:
    """Sunlight that falls through windows onto furniture and floors.

    Args:
        caster: Tells what stands in its way.
        openings: The windows; those that look away from the sun have none.
    """

    def __init__(self, caster: RayCaster, openings: Sequence[Opening]) -> None:
        self._caster = caster
        toward = _toward(openings)
        self.openings = [each for each in openings if -(each.inward @ toward) > 0.1]
        self.toward = toward
        self.rays = -toward
        middle = np.mean([each.start + each.along / 2 for each in openings], axis=0) if openings else np.zeros(3)
        across = np.cross(toward, np.array((0.0, 0.0, 1.0)))
        across /= max(float(np.linalg.norm(across)), 1e-6)
        up = np.cross(across, toward)
        disc = [(_SUN_FAR_M * _SUN_RADIUS * sqrt((n + 0.5) / SUNS), n * 2.399963) for n in range(SUNS)]
        self._places = [
            middle + toward * _SUN_FAR_M + out * (cos(turn) * across + sin(turn) * up) for out, turn in disc
        ]

    def patches(self, rng: np.random.Generator) -> list[list[Lamp]]:
        """Returns lamps in each window that have the power of the sunlight through it."""
        sets: list[list[Lamp]] = []
        for each in self.openings:
            power = _SUN_POWER * -float(each.inward @ self.toward) * each.wide_m * each.up_m / (2 * pi)
            color = _vector(_SUN_COLOR)
            spots = [
                each.start + a * each.along + np.array((0, 0, b * each.up_m)) for a, b in rng.random((_PER_SET, 2))
            ]
            sets.append(
                [Lamp(_vector(spot + 0.1 * each.inward), power, color, _vector(-self.toward)) for spot in spots]
            )
        return sets

    def light(self, hits: Hits, numbers: NDArray[np.int64]) -> Array:
        """Returns the sunlight at points from one of the places on the sun's disc each, shape (n, 3)."""
        light = np.zeros((len(hits.geoms), 3))
        facing = hits.normals @ self.toward
        may = (facing > 0) & (hits.geoms >= 0)
        for number, place in enumerate(self._places):
            mine = np.flatnonzero(may & (numbers == number))
            ways = place - hits.places[mine]
            ways /= np.linalg.norm(ways, axis=1)[:, None]
            through = np.zeros(len(mine), np.bool_)
            for each in self.openings:
                through |= _passes(each, hits.places[mine], ways)
            lit = mine[through]
            if len(lit) == 0:
                continue
            start = hits.places[lit] + hits.normals[lit] * 0.004 - place
            reach = np.linalg.norm(start, axis=1)
            _, met, _ = self._caster.trace(_vector(place), start / reach[:, None])
            lit = lit[(met < 0) | (met > reach - 0.015)]
            light[lit] = _SUN_POWER * facing[lit, None] * _SUN_COLOR
        return light


def _toward(openings: Sequence[Opening]) -> Array:
    """Returns the direction to the sun: the one of sixteen from which most of its light comes in."""
    best, most = np.array((0.0, 0.0, 1.0)), -1.0
    for number in range(16):
        turn = (number + 0.4) * pi / 8  # never straight along a wall
        toward = np.array((cos(turn), sin(turn), _SUN_RISE)) / hypot(1.0, _SUN_RISE)
        # The first windows are the room's own: they count more.
        comes_in = sum(
            each.wide_m * max(0.0, float(-(each.inward @ toward)) - 0.15) / (1 + 0.3 * place)
            for place, each in enumerate(openings)
        )
        if comes_in > most + 1e-9:
            best, most = toward, comes_in
    return best


def _passes(opening: Opening, places: Array, ways: Array) -> Flags:
    """Returns a mask of the rays from places, in directions, that lead through a window or just beside it."""
    slope = ways @ opening.inward
    away = ((opening.start - places) @ opening.inward) / np.where(np.abs(slope) < 1e-6, 1e-6, slope)
    crossing = places + ways * away[:, None] - opening.start
    share = _SLACK_M / opening.wide_m
    along = (crossing @ opening.along) / opening.wide_m**2
    up_m = crossing[:, 2]
    return (away > 0) & (along > -share) & (along < 1 + share) & (up_m > -_SLACK_M) & (up_m < opening.up_m + _SLACK_M)
