"""Rugs and small things of a world as a picture from above shows them: as boxes, posts and balls of their size."""

from collections.abc import Iterator
from math import atan2

from ....schemas.worlds.world import GazeboSource, World
from ..decor.decor import ornaments
from ..furniture.placed_parts import Solid
from ..geometry.parts import Color, Shape, Vector
from ..ornaments.ornament_shapes import Shapes
from ..ornaments.ornaments import Ornament

RUG = "rug_"
"""Beginning of the names of rugs."""
_SEEN = (RUG, "thing_")
"""Beginnings of the names of decoration that one sees from above, over walls that are cut."""
_ON_SHELVES = "thing_shelf_"
"""Beginning of the names of things on shelves, which hang above the cut of walls and are not drawn."""
_LEAST_M = 0.07
"""Least size of a thing that is drawn, in metres; smaller ones are two pixels wide."""
_LEAFY = ("bush", "flowers", "fruit", "sprigs")
_ROUND = ("bottle", "bowl", "glass", "jar", "kettle", "mug", "pan", "plate", "pot", "vase")


def things_from_above(world: World) -> Iterator[Solid]:
    """Yields the rugs and small things of a world that its picture from above shows.

    Args:
        world: The world; those from Gazebo have no decoration of ours.
    """
    if isinstance(world.source, GazeboSource):
        return
    for ornament in ornaments(world, Shapes()):
        if ornament.name.startswith(_SEEN) and not ornament.name.startswith(_ON_SHELVES):
            shape, size = _form(ornament)
            if max(size[0], size[1]) >= _LEAST_M:
                yield Solid(ornament.name, shape, ornament.center, size, "z", _yaw(ornament), _color(ornament), False)


def _form(ornament: Ornament) -> tuple[Shape, Vector]:
    """Returns an ornament's shape and full extents in metres; leaves become an ellipsoid.

    The name of a mesh says its form and its extents in millimetres.
    """
    if not ornament.mesh:
        x, y, z = ornament.size
        return "box", (2 * x, 2 * y, 2 * z)
    form, *extents = ornament.mesh.removeprefix("shape_").rsplit("_", 3)
    x, y, z = (int(extent) / 1000 for extent in extents)
    if form in _LEAFY:
        return "ellipsoid", (x, y, z)
    return ("cylinder", (min(x, y), min(x, y), z)) if form in _ROUND else ("box", (x, y, z))


def _yaw(ornament: Ornament) -> float:
    if not ornament.quat:
        return 0.0
    cosine, _, _, sine = map(float, ornament.quat.split())
    return 2 * atan2(sine, cosine)


def _color(ornament: Ornament) -> Color:
    red, green, blue, alpha = map(float, ornament.look.split('"')[1].split())
    return red, green, blue, alpha
