"""Reads a map of Nav2's map server as a drawing: its free space is split into rooms at narrow places.

A map has no names: rooms are `area-1`, the largest, `area-2` and so on, and their types are guesses by size.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from scipy import ndimage

from ....schemas.specs.yaml_nodes import parse, plain
from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.world import FurnishedRoomType, Point
from ..floorplans.partition import Corners, extent, turns
from ..floorplans.walls import room_units
from .coarse_rooms import coarse_rooms
from .drawn_shapes import MOST_ROOMS, Drawing, Shape
from .squaring import outline_of

Cells = NDArray[np.bool_]

_NARROW_M = 0.55
"""Half the width of the widest door, in metres: where free space is narrower, one room ends and another begins."""
_SPECK_M2 = 0.02
"""Smallest area of a wall, in square metres: eight cells of 5 cm; less than this is ignored."""
_GAP_CELLS = 5
_MOSTLY = 0.6
"""Share of free cells around an unknown cell from which on that cell counts as free, too.

Beside a wall half of them are.
"""
_LEAST_CORE_M2 = 0.05
_LEAST_ROOM_M2 = 1.5
_STRAIGHT_M = 0.2
"""Distance in metres below which a short edge of a room is moved onto the line of a longer one."""
_DOOR_M = 1.3
"""Largest width of a door on a Nav2 map, in metres; a wider gap is an opening."""
_NARROWEST_M = 0.5
"""Smallest width of a door, in metres; what is narrower is noise, or a gap that no robot passes."""
_LEAST_JOINED = 0.8
"""Smallest share of all rooms' area that must be connected by doors; unconnected rooms are left out."""
_BLUR_M = 0.1
"""Size of bumps in walls that are ignored when the direction of walls is measured, in metres."""
_MOST_LEAN_DEG = 3.0
"""Largest angle of walls against the map's axes, in degrees.

5 cm on a metre, which the lines of a coarse outline follow.
"""
_CLEAR = 0.3
"""Share of walls that must agree on a direction; walls of arcs and furniture have a tenth."""
_MOST_SHARED_M2 = 0.1
"""Largest overlap of two rooms' outlines after their edges were made straight, in square metres."""
_MOST_CELLS = 4_000_000
_MOST_CORNERS = 24
_LONG = 2.5


class _Map(NamedTuple):
    """Mask of the free cells of a Nav2 map, rows from south to north."""

    free: Cells
    resolution_m: float
    origin: Point

    def point(self, x: float, y: float) -> Point:
        """Converts a cell corner of the map to metres."""
        return self.origin[0] + x * self.resolution_m, self.origin[1] + y * self.resolution_m


def read_nav2_map(path: Path, *, coarse: bool = False) -> tuple[Drawing, float]:
    """Reads a Nav2 occupancy map as a drawing of rooms.

    Args:
        path: Path of the map's `map.yaml`.
        coarse: Whether outlines follow the walls' common lines only, for maps with bumps and furniture.

    Returns:
        A drawing in metres, and the side of a cell.

    Raises:
        ConfigurationError: The map cannot be read, or has no rooms.
    """
    read = _read(path)
    _refuse_slanted(read, path.name)
    regions = _regions(read, path.name)
    _refuse_enclosed(regions, read, path.name)
    order = _by_size(regions)
    remarks: list[str] = []
    if coarse:
        straight = coarse_rooms(regions, read.resolution_m)
        order = [number for number in order if (straight == number).any()]
        outlines = [_steps_outline(straight == number) for number in order]
        _refuse_corners(outlines, read, path.name)
        remarks.append("bumps of walls: outlines run along the lines that most of the walls are near")
    else:
        near = round(_STRAIGHT_M / read.resolution_m)
        outlines = [_straight(_steps_outline(regions == number), near) for number in order]
        _refuse_corners(outlines, read, path.name)
        _refuse_overlaps(outlines, read, path.name)
    found = list(_doors(regions, order, read))
    areas = {place: int(np.count_nonzero(regions == number)) for place, number in enumerate(order, 1)}
    joined = _joined([pair for pair, _ in found], areas)
    _refuse_apart(joined, areas, outlines, read, path.name)
    if apart := len(order) - len(joined):
        remarks.append(f"{apart} area{'s' * (apart > 1)} that no door leads to")
    kept = sorted(joined)
    doors = [(pair, _renamed(shape, pair, kept)) for pair, shape in found if joined.issuperset(pair)]
    rooms = [
        Shape(
            tuple(read.point(x, y) for x, y in outlines[place - 1]), True, False, f"area-{number}", ("room",),
            {"type": _guess(outlines[place - 1], number, sum(place in pair for pair, _ in doors))}, f"area-{number}",
        )
        for number, place in enumerate(kept, 1)
    ]  # fmt: skip
    left_out = [_lost([outlines[place - 1] for place in kept], read), *remarks]
    shapes = [*rooms, *(door for _, door in doors)]
    return Drawing(shapes, [], 1.0, None, left_out, is_exact=False), read.resolution_m


def _joined(pairs: Sequence[tuple[int, int]], areas: Mapping[int, int]) -> set[int]:
    """Returns the indices of the rooms that doors connect: the connected group with the largest area."""
    groups: list[set[int]] = []
    for place in areas:
        group = {place}
        while grown := {each for pair in pairs if group & {*pair} for each in pair} - group:
            group |= grown
        groups.append(group)
    return max(groups, key=lambda group: sum(areas[place] for place in group))


def _refuse_apart(
    joined: Collection[int], areas: Mapping[int, int], outlines: Sequence[Corners], read: _Map, name: str
) -> None:
    """Raises ConfigurationError if doors connect too small a part of a map's rooms for the rest to be noise."""
    share = sum(areas[place] for place in joined) / sum(areas.values())
    if share >= _LEAST_JOINED:
        return
    told: list[str] = []
    for place in sorted(areas.keys() - joined):
        x, y = read.point(*(float(np.mean(axis)) for axis in zip(*outlines[place - 1], strict=True)))
        told.append(f"area-{place} ({x:.1f}, {y:.1f}) m")
    raise ConfigurationError(
        f"{name}: no door leads from area-{min(joined)} to {', '.join(told)}: {1 - share:.0%} of rooms would be left "
        f"out, and at most {1 - _LEAST_JOINED:.0%} may be; gaps of at least {_NARROWEST_M:g} m would have to join them"
    )


def _renamed(door: Shape, pair: tuple[int, int], kept: Sequence[int]) -> Shape:
    name = " to ".join(f"area-{kept.index(place) + 1}" for place in pair)
    return door._replace(name=name, place=name)


def _by_size(regions: NDArray[np.int64]) -> list[int]:
    """Returns the numbers of a map's rooms, the largest room first."""
    areas = np.bincount(regions.ravel())[1:]
    return [number + 1 for number in np.argsort(areas)[::-1].tolist()]


def map_files(path: Path) -> list[Path]:
    """Lists the files of a Nav2 map: `map.yaml` and its image.

    Raises ConfigurationError if `map.yaml` cannot be read or is none of a map; the image need not be there.
    """
    said = _document(path)
    return [path, path.parent / str(said.get("image", ""))]


def _document(path: Path) -> dict[str, Any]:
    try:
        said = plain(parse(path.read_text(encoding="utf-8"), path.name))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: it cannot be read: {error}") from error
    if not isinstance(said, dict) or not {"image", "resolution", "origin"} <= said.keys():
        raise ConfigurationError(f"{path}: a map has image, resolution and origin; for notes name the drawing itself")
    return said


def _read(path: Path) -> _Map:
    said = _document(path)
    picture = path.parent / str(said["image"])
    try:
        with Image.open(picture) as image:
            if image.width * image.height > _MOST_CELLS:
                raise ConfigurationError(f"{picture}: it has more than {_MOST_CELLS} cells")
            grey = np.asarray(image.convert("L"), np.float64)[::-1]
        resolution, x, y = float(said["resolution"]), float(said["origin"][0]), float(said["origin"][1])
        turn = float(said["origin"][2]) if len(said["origin"]) > 2 else 0.0
        free_below = float(said.get("free_thresh", 0.196))
        occupied_above = float(said.get("occupied_thresh", 0.65))
    except (OSError, UnidentifiedImageError) as error:
        raise ConfigurationError(f"{picture}: it cannot be read: {error}") from error
    except (TypeError, ValueError, IndexError) as error:
        raise ConfigurationError(f"{path}: resolution, origin or a threshold is no number: {error}") from error
    if not 0.005 <= resolution <= 0.25:
        raise ConfigurationError(f"{path}: resolution is {resolution:g}; 0.005 to 0.25 m a cell would be right")
    if turn:
        raise ConfigurationError(
            f"{path}: origin says that the map is turned by {turn:g} rad; 0 would be right, with the picture turned"
        )
    occupied = grey / 255 if said.get("negate") else (255 - grey) / 255
    free = occupied < free_below
    # Cells in the middle of a room that no ray happened to end in or pass.
    seen = np.asarray(ndimage.uniform_filter(free.astype(np.float64), _GAP_CELLS))
    free |= (occupied <= occupied_above) & (seen > _MOSTLY)
    return _Map(_without_specks(free, resolution), resolution, (x, y))


def _without_specks(free: Cells, resolution_m: float) -> Cells:
    """Clears occupied cells in groups too small for a wall: legs of chairs, people who walked by, a lidar's noise.

    Returns a new mask of free cells.
    """
    found = ndimage.label(~free, np.ones((3, 3)))[0]  # pyright: ignore[reportIndexIssue]
    parts: NDArray[np.int64] = np.asarray(found).astype(np.int64)
    small = np.bincount(parts.ravel()) * resolution_m**2 < _SPECK_M2
    return free | small[parts]


def _regions(read: _Map, name: str) -> NDArray[np.int64]:
    """Labels each free cell of a map with the number of its room, from 1; cells in no room have 0.

    Raises ConfigurationError if the map has no free space as large as a room, or too many of them.
    """
    size = read.resolution_m
    depth = np.asarray(ndimage.distance_transform_edt(read.free)) * size
    found = ndimage.label(depth > _NARROW_M)[0]  # pyright: ignore[reportIndexIssue]
    cores: NDArray[np.int64] = np.asarray(found).astype(np.int64)
    large = np.bincount(cores.ravel()) * size**2 >= _LEAST_CORE_M2
    regions = np.where(large[cores], cores, 0)
    # All rooms grow at the same pace until they meet, which is in doorways.
    while True:
        grown = np.asarray(ndimage.maximum_filter(regions, size=3))
        fresh = read.free & (regions == 0) & (grown > 0)
        if not fresh.any():
            break
        regions[fresh] = grown[fresh]
    areas = np.bincount(regions.ravel()) * size**2
    kept = [number for number in range(1, len(areas)) if areas[number] >= _LEAST_ROOM_M2]
    if not kept:
        raise ConfigurationError(f"{name}: the map has no free space as large as a room")
    if len(kept) > MOST_ROOMS:
        raise ConfigurationError(f"{name}: its free space falls into {len(kept)} areas; at most {MOST_ROOMS} are right")
    numbers = np.zeros(len(areas), np.int64)
    numbers[kept] = np.arange(1, len(kept) + 1)
    return numbers[regions]


def _refuse_corners(outlines: Sequence[Corners], read: _Map, name: str) -> None:
    if not outlines:
        raise ConfigurationError(f"{name}: most of its walls are shorter than 1 m; a map of rooms would be right")
    for corners in outlines:
        if not 4 <= len(corners) <= _MOST_CORNERS:
            x, y = read.point(*(float(np.mean(axis)) for axis in zip(*corners, strict=True)))
            raise ConfigurationError(
                f"{name}: the room around ({x:.1f}, {y:.1f}) m has {len(corners)} corners; a map of straight walls "
                "along its rows and columns would be right, with little furniture in it"
            )


def _steps_outline(cells: Cells) -> Corners:
    return outline_of(_steps(np.asarray(ndimage.binary_fill_holes(cells))))


def _steps(cells: Cells) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Returns the border edges of a room's map cells as (start, end) corners, with the room to the left of each."""
    level = np.diff(np.pad(cells, ((1, 1), (0, 0))).astype(np.int8), axis=0)
    upright = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    east, west, south, north = (np.argwhere(at).tolist() for at in (level > 0, level < 0, upright > 0, upright < 0))
    return [
        *(((x, y), (x + 1, y)) for y, x in east),
        *(((x + 1, y), (x, y)) for y, x in west),
        *(((x, y + 1), (x, y)) for y, x in south),
        *(((x, y), (x, y + 1)) for y, x in north),
    ]


def _straight(corners: Corners, near: int) -> Corners:
    """Returns a room's outline with short edges, of at most `near` cells, moved onto the lines of longer ones."""
    lines: tuple[dict[int, int], dict[int, int]] = ({}, {})
    edges = list(zip(corners, [*corners[1:], *corners[:1]], strict=True))
    for one, other in sorted(edges, key=lambda edge: -abs(edge[0][0] - edge[1][0]) - abs(edge[0][1] - edge[1][1])):
        axis = 0 if one[0] == other[0] else 1
        chosen = lines[axis]
        at = one[axis]
        chosen.setdefault(at, next((line for line in sorted(chosen.values()) if abs(line - at) <= near), at))
    kept = tuple((lines[0][x], lines[1][y]) for x, y in corners)
    while (fewer := turns(kept)) != kept:
        kept = fewer
    return kept


def _doors(regions: NDArray[np.int64], order: Sequence[int], read: _Map) -> Iterator[tuple[tuple[int, int], Shape]]:
    """Yields doors and openings between two rooms of a map.

    Each has the rooms' positions in `order`, and the line between them.
    """
    boxes = ndimage.find_objects(regions)
    for place, number in enumerate(order, 1):
        rows, columns = (slice(max(0, side.start - 1), side.stop + 1) for side in boxes[number - 1])
        around = regions[rows, columns]
        grown = np.asarray(ndimage.binary_dilation(around == number))
        for after, other in enumerate(order[place:], place + 1):
            labels, count = ndimage.label(grown & (around == other), np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
            for up, along in ndimage.find_objects(labels, count):
                south_west = read.point(columns.start + along.start, rows.start + up.start)
                north_east = read.point(columns.start + along.stop, rows.start + up.stop)
                wide = max(north_east[0] - south_west[0], north_east[1] - south_west[1])
                if wide >= _NARROWEST_M:
                    kind = "door" if wide <= _DOOR_M else "opening"
                    yield (place, after), Shape((south_west, north_east), True, False, "", (kind,), {}, "")


def _refuse_slanted(read: _Map, name: str) -> None:
    """Raises ConfigurationError, which says how far to turn the map, if its walls are not along rows and columns."""
    up, along = np.gradient(
        np.asarray(ndimage.gaussian_filter(read.free.astype(np.float64), _BLUR_M / read.resolution_m))
    )
    # Directions of walls are the same after a quarter turn, so four times their angles have a mean.
    turned = complex(np.sum(np.hypot(along, up) * np.exp(4j * np.arctan2(up, along))))
    degrees = np.degrees(np.angle(turned)) / 4
    if abs(turned) >= _CLEAR * np.sum(np.hypot(along, up)) > 0 and abs(degrees) > _MOST_LEAN_DEG:
        side = "clockwise" if degrees > 0 else "counter-clockwise"
        raise ConfigurationError(
            f"{name}: the walls lean by {abs(degrees):.1f} degrees; a map of walls along its rows and columns would be "
            f"right: turn its picture {side} by {abs(degrees):.1f} degrees, with unknown cells in the corners"
        )


def _refuse_enclosed(regions: NDArray[np.int64], read: _Map, name: str) -> None:
    """Raises an error if the map shows free space all around the flat.

    That space is no room, and all rooms would be inside of it.
    """
    for place, number in enumerate(_by_size(regions), 1):
        cells = regions == number
        inside = np.asarray(ndimage.binary_fill_holes(cells)) & ~cells & (regions > 0)
        if np.count_nonzero(inside) * read.resolution_m**2 > _MOST_SHARED_M2:
            x, y = read.point(*(float(np.mean(axis)) for axis in np.nonzero(inside)[::-1]))
            raise ConfigurationError(
                f"{name}: the free space of area-{place} lies all around the rooms near ({x:.1f}, {y:.1f}) m; what is "
                "outside of the flat would have to be unknown"
            )


def _refuse_overlaps(outlines: Sequence[Corners], read: _Map, name: str) -> None:
    """Raises ConfigurationError if outlines of two rooms overlap because the walls between them are too rough."""
    owner = np.zeros(read.free.shape, np.int64)
    for place, corners in enumerate(outlines, 1):
        x, y = min(x for x, _ in corners), min(y for _, y in corners)
        inside = room_units(corners)
        cells = owner[y : y + inside.shape[0], x : x + inside.shape[1]]
        shared = inside & (cells > 0)
        if np.count_nonzero(shared) * read.resolution_m**2 > _MOST_SHARED_M2:
            other = int(np.bincount(cells[shared]).argmax())
            row, column = (float(np.mean(axis)) for axis in np.nonzero(shared))
            at_x, at_y = read.point(x + column, y + row)
            raise ConfigurationError(
                f"{name}: around ({at_x:.1f}, {at_y:.1f}) m the free space of area-{other} reaches into or around that "
                f"of area-{place}; what is outside of the flat would have to be unknown, and walls to be clear"
            )
        cells[inside] = place


def _guess(corners: Corners, place: int, doors: int) -> FurnishedRoomType:
    """Guesses the type of a room of a map from its size, form and doors; the notes file may correct it."""
    box = extent(corners)
    short, long = sorted((box.x1 - box.x0, box.y1 - box.y0))
    if doors >= 3 and (long >= _LONG * short or len(corners) > 4):
        return "Hallway"
    return "Living" if place == 1 else "Bedroom"


def _lost(outlines: Sequence[Corners], read: _Map) -> str:
    """Returns the share of the map's free space that is in no room, as a text."""
    covered = np.zeros_like(read.free)
    for corners in outlines:
        x, y = min(x for x, _ in corners), min(y for _, y in corners)
        inside = room_units(corners)
        covered[y : y + inside.shape[0], x : x + inside.shape[1]] |= inside
    lost = np.count_nonzero(read.free & ~covered) / max(1, np.count_nonzero(read.free))
    return f"{lost:.1%} of the map's free cells, which are in no room"
