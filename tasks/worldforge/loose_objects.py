"""Small things that lie about: free bodies at rest on the floor or on a table."""

import numpy as np

from ...schemas.world import Furniture, RoomType
from .arrangement import DENSITIES, Density
from .furniture import styles_of
from .parts import Style
from .placement import rect
from .room_furnishing import RoomFurnishing

MOST_LOOSE = 10
"""Loose objects per world: awake bodies are what a simulation's time goes into."""

# Where a book may lie, as a share of the top's depth and width: beside what is drawn on it already.
_BOOK_SPOTS: dict[str, tuple[float, float]] = {
    "CoffeeTables": (0.0, -0.28),
    "DiningTables": (0.2, 0.28),
    "Desks": (0.05, 0.36),
}
_ON_FLOOR: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Ball", "ToyBlock", "ToyBlock", "Book"),
    "Bathroom": ("Carton",),
    "Living": ("Ball", "ToyBlock", "Book"),
    "Dining": ("ToyBlock", "Carton"),
    "Kitchen": ("Carton",),
    "Hallway": ("Carton", "Ball"),
    "Closet": ("Carton", "Carton", "ToyBlock"),
}
_COUNTS: dict[Density, int] = {"Sparse": 0, "Moderate": 1, "Dense": 3}
_TRIES = 12


def scatter(furnished: RoomFurnishing, room_for: int) -> list[Furniture]:
    """Adds loose objects to a furnished room.

    Args:
      furnished: the room with its furniture; the objects' places are taken in its space.
      room_for: how many objects the world may still get.

    Returns:
      The objects, all at rest: nothing leans, nothing overhangs.
    """
    rng = furnished.rng
    objects: list[Furniture] = []
    for host in [item for item in furnished.items if item.model_type in _BOOK_SPOTS]:
        if len(objects) < room_for and rng.random() < (0.25, 0.5, 0.75)[DENSITIES.index(furnished.density)]:
            objects.append(_book_on(host, furnished))
    for _ in range(_COUNTS[furnished.density]):
        if len(objects) < room_for:
            found = _on_floor(furnished)
            objects += [found] if found else []
    return objects


def _style(kind: str, rng: np.random.Generator) -> Style:
    known = styles_of(kind)
    return known[int(rng.integers(len(known)))]


def _book_on(host: Furniture, furnished: RoomFurnishing) -> Furniture:
    along, across = _BOOK_SPOTS[host.model_type]
    along, across = along * host.depth_m, across * host.width_m
    c, s = np.cos(host.yaw), np.sin(host.yaw)
    turn = float(furnished.rng.uniform(-0.3, 0.3))
    x, y = host.x + along * c - across * s, host.y + along * s + across * c
    return _thing(
        "Book", _style("Book", furnished.rng), furnished, (x, y, host.yaw + turn), host.base_m + host.height_m
    )


def _on_floor(furnished: RoomFurnishing) -> Furniture | None:
    """An object at a free spot that leaves the ways open; None when none of some random spots does."""
    rng, space = furnished.rng, furnished.space
    kinds = _ON_FLOOR[furnished.room.type]
    kind = kinds[int(rng.integers(len(kinds)))]
    style = _style(kind, rng)
    x0, y0, x1, y1 = space.bounds
    for _ in range(_TRIES):
        x, y = float(rng.uniform(x0 + 0.3, x1 - 0.3)), float(rng.uniform(y0 + 0.3, y1 - 0.3))
        half = np.hypot(style.width_m, style.depth_m) / 2 + 0.03
        footprint = rect(x - half, y - half, x + half, y + half)
        if space.fits(footprint, footprint)[0] and space.stays_open(footprint):
            thing = _thing(kind, style, furnished, (x, y, float(rng.uniform(-3.1, 3.1))), 0.0)
            space.add(thing.id, footprint, footprint)
            return thing
    return None


def _thing(
    kind: str, style: Style, furnished: RoomFurnishing, pose: tuple[float, float, float], base_m: float
) -> Furniture:
    x, y, yaw = pose
    return Furniture(
        id=furnished.new_id(kind),
        model_type=kind,
        style=style.name,
        room=furnished.room.name,
        x=round(x, 3),
        y=round(y, 3),
        yaw=round(yaw, 3),
        width_m=style.width_m,
        depth_m=style.depth_m,
        height_m=style.height_m,
        base_m=base_m,
        movable=True,
    )
