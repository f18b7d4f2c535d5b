"""Ceilings that one sees from below only: views from above look into the rooms."""

from collections.abc import Iterator

from ....schemas.worlds.world import World
from ..interiors.placement import room_rects
from ..ornaments.ornaments import Mesh, Ornament, joined, sheet

CEILING = "ceiling"
"""Their material."""

_RIM_M = 0.05
_CELL_M = 0.8
_BELOW_M = 0.004


def ceilings(world: World) -> Iterator[tuple[Ornament, Mesh]]:
    """A shallow tray, open at the top, over each rectangle of a room: renderers leave out faces that look away."""
    for index, room in enumerate(world.floorplan.rooms):
        for number, (x0, y0, x1, y1) in enumerate(room_rects(room).tolist()):
            name = f"ceiling_{index}_{number}"
            wide, deep = x1 - x0, y1 - y0
            cells = max(1, round(wide / _CELL_M)), max(1, round(deep / _CELL_M))
            up = (0.0, 0.0, _RIM_M)
            tray = joined(
                [
                    sheet((0.0, deep, 0.0), (wide, 0.0, 0.0), (0.0, -deep, 0.0), cells),
                    sheet((0.0, 0.0, 0.0), (wide, 0.0, 0.0), up, (1, 1)),
                    sheet((wide, 0.0, 0.0), (0.0, deep, 0.0), up, (1, 1)),
                    sheet((wide, deep, 0.0), (-wide, 0.0, 0.0), up, (1, 1)),
                    sheet((0.0, deep, 0.0), (0.0, -deep, 0.0), up, (1, 1)),
                ]
            )
            # A little below the walls' upper ends, which would shine through.
            place = (x0, y0, world.floorplan.ceiling_height_m - _BELOW_M)
            yield Ornament(name, "mesh", place, (), f'material="{CEILING}"', mesh=name), Mesh(*tray)
