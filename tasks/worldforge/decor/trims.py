"""Skirting boards at the foot of plastered and papered walls."""

from collections.abc import Iterator, Sequence

from ....schemas.worlds.world import World
from ..geometry.parts import rgb
from ..materials.materials import surface_finish, surface_name
from ..ornaments.ornaments import Ornament
from .faces import Face

SKIRTED = ("plain", "stripes", "trellis", "sprigs", "panels")
"""Patterns of walls that have skirting; tiles, bricks and stones go down to the floor."""

_HEIGHT_M = 0.08
_THICK_M = 0.012
_CASING_M = 0.06
_COLOR = rgb("f3f1ec")


def skirting(world: World, faces: Sequence[Face]) -> Iterator[Ornament]:
    """A board along each face of a wall; walls end at ways between rooms, so boards do."""
    ends = {end for passage in world.floorplan.passages if passage.door for end in (passage.start, passage.end)}
    for number, face in enumerate(faces):
        if surface_finish(surface_name("wall", face.room)).pattern not in SKIRTED:
            continue
        low, high = face.span
        first, last = sorted((face.wall.start, face.wall.end))
        # Casings of doors stand beside the doorway, as far out as the board.
        low, high = low + _CASING_M * (first in ends), high - _CASING_M * (last in ends)
        if high - low > 0.02:
            yield face.bar(f"skirting_{number}", (low, high), (0.0, _THICK_M), (0.0, _HEIGHT_M), _COLOR)
