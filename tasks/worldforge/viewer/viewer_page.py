"""A world as an HTML page that shows it in three dimensions, in any browser, without a network.

Everything is in the page: the GLB, and a viewer of our own (`viewer*.js`) on WebGL 2.
"""

import base64
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ....schemas.worlds.world import Room, World
from ..bundle.bundle import read_world
from ..exports.glb import world_glb
from ..proofs.guarantees import violations
from .page_files import json_island, page

_SCRIPTS = ("viewer_glb.js", "viewer_gl.js", "viewer.js")


def viewer_page(bundle: Path, title: str) -> str:
    """The page of a bundle's world.

    Args:
      bundle: the world's bundle.
      title: what to call the world.

    Raises:
      FileNotFoundError: the bundle lacks `world.json` or `world.xml`.
      ValueError: one of them is none.
    """
    world = read_world(bundle)
    glb = base64.b64encode(world_glb(bundle)).decode("ascii")
    return page(
        "viewer.html.j2",
        "viewer.css",
        _SCRIPTS,
        title=title,
        lines=_lines(world),
        verdict=_verdict(world),
        world=json_island({"rooms": [_room(room) for room in world.floorplan.rooms]}),
        glb=Markup(glb),  # noqa: S704
    )


def _lines(world: World) -> list[str]:
    rooms = world.floorplan.rooms
    loose = sum(item.movable for item in world.furniture)
    return [
        f"{len(rooms)} rooms, {sum(room.area_m2 for room in rooms):.1f} m²",
        f"{len(world.furniture) - loose} pieces of furniture, {loose} loose objects",
    ]


def _verdict(world: World) -> dict[str, Any]:
    if world.checks is None:
        return {"good": False, "text": "Never checked"}
    broken = violations(world.checks)
    return {"good": not broken, "text": "; ".join(broken) or "All guarantees hold"}


def _room(room: Room) -> dict[str, Any]:
    xs, ys = zip(*room.polygon, strict=True)
    return {
        "name": room.original_name or room.name,
        "area_m2": room.area_m2,
        "x": room.goal[0],
        "y": room.goal[1],
        "west": min(xs),
        "east": max(xs),
        "south": min(ys),
        "north": max(ys),
    }
