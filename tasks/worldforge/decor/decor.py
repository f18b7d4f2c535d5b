"""All that decorates a world: meshes and geoms of MJCF, from the world and its seeds alone."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from random import Random

from ....schemas.worlds.world import Wall, World
from ..ornaments.forms import Shapes
from ..ornaments.ornaments import Mesh, Ornament, mesh_path
from .ceilings import ceilings
from .curtains import curtains
from .faces import faces, windows_in
from .furnishings import furnishings
from .lights import lamp_shades
from .on_tops import things_on_tops
from .openings import pierced_wall, window_frames
from .trims import skirting

Sides = Callable[[Wall, World], tuple[str, str]]
"""Surfaces of a wall's right and left face."""


@dataclass(slots=True)
class Decoration:
    """Decoration of a world, as MJCF."""

    assets: list[str] = field(default_factory=list)
    """Lines of meshes."""
    geoms: list[str] = field(default_factory=list)
    """Lines of geoms for the `worldbody`."""
    files: dict[str, str] = field(default_factory=dict)
    """Texts of the files that the meshes name, by their paths from where the model is."""


def decorate(world: World, sides: Sides, shapes: Shapes) -> Decoration:
    """Decorates a world.

    Args:
        world: the world.
        sides: tells the surfaces of walls.
        shapes: gathers the meshes of what stands and hangs about.
    """
    made = Decoration()
    for ornament, mesh in _ornaments(world, sides, shapes):
        made.geoms.append(ornament.line())
        if mesh is None:
            continue
        made.assets.append(mesh.line(ornament.mesh))
        if mesh.places is not None:
            made.files[mesh_path(ornament.mesh)] = mesh.obj_text()
    return made


def _ornaments(world: World, sides: Sides, shapes: Shapes) -> Iterator[tuple[Ornament, Mesh | None]]:
    # As cheap and as lasting as chance gets: nothing else takes draws from it.
    dice = Random(world.floorplan_seed * 1_000_003 + world.interior_seed)  # noqa: S311 (chance, not secrecy)
    walls = list(faces(world))
    for number, wall in enumerate(world.floorplan.walls):
        if windows_in(wall, world):
            yield from pierced_wall(number, wall, sides(wall, world), world)
    yield from ceilings(world)
    yield from lamp_shades(world)
    for ornament in (
        *window_frames(world, walls),
        *skirting(world, walls),
        *curtains(world, walls, shapes, dice),
        *furnishings(world, walls, shapes, dice),
        *things_on_tops(world, shapes, dice),
    ):
        yield ornament, None
