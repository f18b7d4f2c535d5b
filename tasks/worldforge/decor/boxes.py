"""Boxes of the furniture in a room, as seen from above."""

from collections.abc import Sequence

from ....schemas.worlds.world import World
from ..geometry.boxes import Box, box_of, hits

Standing = tuple[Box, float]
"""Box that a piece covers, and its height, in metres."""


def covered(world: World, room: str) -> list[Standing]:
    """The pieces of a room that stand on its floor."""
    return [
        (box_of(item), item.height_m) for item in world.furniture if item.room == room and not item.movable
    ]  # fmt: skip


def free_height(spot: Box, standing: Sequence[Standing]) -> float:
    """Height of the highest piece that stands in a spot; 0 where none does."""
    return max((height for box, height in standing if hits(spot, (box,))), default=0.0)
