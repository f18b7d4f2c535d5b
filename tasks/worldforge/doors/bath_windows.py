"""Adds windows to bathrooms: one small window in the longest outer wall, for air and light.

Windows of other rooms come from the search for floor plans, which weighs daylight. A bathroom's window depends only on
its walls and not on chance, so that the plans of existing seeds stay the same.
"""

from math import dist

from ....schemas.worlds.world import Floorplan, Wall, Window

_GRID = 20
"""Grid steps of 5 cm in a metre; all floor plans have coordinates on this grid."""

_BESIDE_STEPS = 8
"""Least length of wall on both sides of a bathroom window, in grid steps: 0.4 m hold the reveal and a towel rail."""

_WIDTHS_STEPS = (16, 12)
"""Widths of a bathroom window in grid steps, the preferred one first: 0.8 m and 0.6 m are the usual small sizes."""


def with_bath_windows(plan: Floorplan) -> Floorplan:
    """Adds a window to each bathroom without one, if an outer wall has space for it; returns the new plan."""
    lit = {window.room for window in plan.windows}
    found: list[Window] = []
    for room in plan.rooms:
        if room.type != "Bathroom" or room.name in lit:
            continue
        walls = [wall for wall in plan.walls if wall.exterior and not wall.lintel and wall.rooms == [room.name]]
        longest = max(walls, key=lambda wall: dist(wall.start, wall.end), default=None)
        window = longest and _in_the_middle(longest, room.name)
        found += [window] if window else []
    return plan.model_copy(update={"windows": [*plan.windows, *found]})


def _in_the_middle(wall: Wall, room: str) -> Window | None:
    """Returns the widest small window that fits in a wall, in its middle; `None` if none fits."""
    across = 0 if wall.start[0] == wall.end[0] else 1
    low, high = sorted(round(end[1 - across] * _GRID) for end in (wall.start, wall.end))
    for width in _WIDTHS_STEPS:
        if high - low >= width + 2 * _BESIDE_STEPS:
            first = low + (high - low - width) // 2
            # Dividing whole numbers gives the nearest float to the decimal, as in all plans.
            ends = [at / _GRID for at in (first, first + width)]
            start, end = [(wall.start[0], at) if across == 0 else (at, wall.start[1]) for at in ends]
            return Window(start=start, end=end, room=room)
    return None
