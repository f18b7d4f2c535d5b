"""Builds a balcony: its floor, railings, the door in the outer wall, and the outline of the building with it."""

from collections.abc import Iterator

from ....schemas.templates.body import TemplateRoom
from ....schemas.worlds.world import Floorplan, Passage, Point, Room, Wall
from ..floorplans.brief import EXTERIOR_WALL, length_over_width
from ..floorplans.floorplan import LINTEL_M
from ..floorplans.partition import UNITS_PER_M
from .sites import RAILING_WALL, Site, is_lost, line_of

RAILING_M = 1.0
"""Height of railings in metres: what building codes ask for up to the fourth floor or so."""

_HALF = RAILING_WALL // 2


def with_balcony(plan: Floorplan, site: Site, wished: TemplateRoom, *, requested: bool) -> Floorplan:
    """Attaches a balcony to a floor plan; its room comes last.

    Args:
        plan: The plan, which is left as it is.
        site: Place of the balcony.
        wished: The room of the template.
        requested: Whether the template asked for the door.
    """
    room = _room(site, wished)
    walls = list(plan.walls)
    walls[site.wall : site.wall + 1] = _pierced(plan.walls[site.wall], site, room.name)
    way = Passage(
        kind="Doorway",
        rooms=(site.host, room.name),
        start=site.point(site.door[0], 0),
        end=site.point(site.door[1], 0),
        width_m=(site.door[1] - site.door[0]) / UNITS_PER_M,
        requested=requested,
    )
    windows = [
        window
        for window in plan.windows
        if line_of(window)[:2] != (site.horizontal, site.at) or not is_lost(line_of(window)[2], site.span, site.door)
    ]
    return plan.model_copy(
        update={
            "footprint": _outline(plan.footprint, site),
            "rooms": [*plan.rooms, room],
            "walls": [*walls, *_railings(site, room.name)],
            "passages": [*plan.passages, way],
            "windows": windows,
        }
    )


def _room(site: Site, wished: TemplateRoom) -> Room:
    low, high = site.span
    long, deep = high - low - RAILING_WALL, site.deep - _HALF - EXTERIOR_WALL // 2
    corners = [site.point(low, 0), site.point(high, 0), site.point(high, site.deep), site.point(low, site.deep)]
    return Room(
        name=wished.Name,
        original_name=wished.OriginalName,
        type=wished.Type,
        polygon=corners if site.horizontal == (site.out > 0) else corners[::-1],
        area_m2=(high - low) * site.deep / UNITS_PER_M**2,
        floor_area_m2=long * deep / UNITS_PER_M**2,
        aspect_ratio=round(max(long, deep) / min(long, deep), 4),
        desired_area_m2=wished.DesiredShape.Area,
        desired_aspect_ratio=length_over_width(wished.DesiredShape.AspectRatio),
        goal=site.point((low + high) // 2, (site.deep + 1) // 2),
    )


def _pierced(wall: Wall, site: Site, balcony: str) -> Iterator[Wall]:
    """Yields the parts of an outer wall beside and behind a balcony, with the gap of its door.

    Over the door, the wall is a lintel; beside it, it reaches the floor.
    """
    _, _, (start, end) = line_of(wall)
    both = [site.host, balcony]
    stretches = (
        (start, site.span[0], [site.host], False),
        (site.span[0], site.door[0], both, False),
        (*site.door, both, True),
        (site.door[1], site.span[1], both, False),
        (site.span[1], end, [site.host], False),
    )
    for low, high, rooms, is_lintel in stretches:
        yield wall.model_copy(
            update={
                "start": site.point(low, 0),
                "end": site.point(high, 0),
                "rooms": rooms,
                "lintel": is_lintel,
                "bottom_m": LINTEL_M if is_lintel else 0.0,
            }
        )


def _railings(site: Site, balcony: str) -> Iterator[Wall]:
    """Yields the railings: the front one fills the corners, the others end at its face and at the wall's."""
    low, high = site.span
    beside = (EXTERIOR_WALL // 2, site.deep - _HALF)
    lines = (
        (site.point(low - _HALF, site.deep), site.point(high + _HALF, site.deep)),
        *((site.point(side, beside[0]), site.point(side, beside[1])) for side in site.span),
    )
    for one, other in lines:
        start, end = sorted((one, other))
        yield Wall(
            start=start,
            end=end,
            thickness_m=RAILING_WALL / UNITS_PER_M,
            exterior=True,
            rooms=[balcony],
            top_m=RAILING_M,
        )


def _outline(footprint: list[Point], site: Site) -> list[Point]:
    """Returns the outline of the building with a balcony.

    Raises AssertionError if the balcony's wall is on no side of it.
    """
    along = 0 if site.horizontal else 1
    low, high = (site.point(each, 0)[along] for each in site.span)
    at = site.point(site.span[0], 0)[1 - along]
    for index, (one, other) in enumerate(zip(footprint, [*footprint[1:], footprint[0]], strict=True)):
        lined = one[1 - along] == other[1 - along] == at
        if lined and min(one[along], other[along]) < low and high < max(one[along], other[along]):
            ends = site.span if one[along] < other[along] else site.span[::-1]
            bay = [(ends[0], 0), (ends[0], site.deep), (ends[1], site.deep), (ends[1], 0)]
            return [*footprint[: index + 1], *(site.point(*each) for each in bay), *footprint[index + 1 :]]
    raise AssertionError(f"no side of the outline has the wall of {site.host} at {at} m")
