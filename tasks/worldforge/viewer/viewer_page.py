"""HTML page that shows a world in three dimensions, in any browser, without a network.

Everything is in the page: the GLB, three.js, which draws it, and the controls (`viewer*.js`).
"""

import base64
import io
import re
import zipfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

from markupsafe import Markup
from trimesh import resources

from ....schemas.wire.common import counted
from ....schemas.worlds.world import PREVIEW_FILE, Room, World, bounds
from ..bundle.bundle import PLAN_FILE, read_world
from ..exports.glb import world_glb
from ..pictures.plan_svg import floorplan_svg
from ..pictures.preview import render_preview
from ..pictures.room_picture import room_picture
from ..proofs.guarantees import violations
from .contact_sheet import json_island, page

_SCRIPTS = ("viewer_gl.js", "viewer.js")
_BEFORE, _AFTER = "<script>", "var camera,controls,scene,renderer"
"""Texts before and after three.js with its GLTFLoader in trimesh's own page."""


def viewer_page(bundle: Path, title: str) -> str:
    """Renders a self-contained HTML page with a 3D view of a world.

    Args:
        bundle: The world's bundle.
        title: Title of the page.

    Raises:
        FileNotFoundError: The bundle lacks `world.json` or `world.xml`.
        ValueError: A file of the world is invalid.
    """
    world = read_world(bundle)
    glb = base64.b64encode(world_glb(bundle)).decode("ascii")
    return page(
        "viewer.html.j2",
        "viewer.css",
        _SCRIPTS,
        three_js(),
        title=title,
        lines=_lines(world),
        verdict=_verdict(world),
        world=json_island({"rooms": [_room(room) for room in world.floorplan.rooms], "bounds": _bounds(world)}),
        glb=Markup(glb),  # noqa: S704
    )


@cache
def three_js() -> str:
    """Returns the JavaScript of three.js with its GLB loader, from the installed trimesh.

    Raises:
        RuntimeError: The trimesh that is installed carries it in another way.
    """
    with zipfile.ZipFile(io.BytesIO(resources.get_bytes("templates/viewer.zip"))) as packed:
        template = packed.read("viewer.html.template").decode("utf-8")
    _, before, rest = template.partition(_BEFORE)
    script, after, _ = rest.partition(_AFTER)
    if not (before and after and "GLTFLoader" in script):
        raise RuntimeError("trimesh's viewer.html.template: has no three.js with GLTFLoader where 5.2 has it")
    return script


def _lines(world: World) -> list[str]:
    rooms = world.floorplan.rooms
    loose = sum(item.movable for item in world.furniture)
    return [
        f"{counted(len(rooms), 'room')}, {sum(room.floor_m2 for room in rooms):.1f} m²",
        f"{len(world.furniture) - loose} pieces of furniture, {counted(loose, 'loose object')}",
    ]


def _verdict(world: World) -> dict[str, Any]:
    if world.checks is None:
        return {"good": False, "text": "Never checked"}
    broken = violations(world.checks)
    return {"good": not broken, "text": "; ".join(broken) or "All guarantees hold"}


def _room(room: Room) -> dict[str, Any]:
    west, south, east, north = bounds(room.polygon)
    return {
        "name": room.called,
        "area_m2": room.floor_m2,
        "x": room.goal[0],
        "y": room.goal[1],
        "west": west,
        "east": east,
        "south": south,
        "north": north,
    }


def _bounds(world: World) -> tuple[list[float], list[float]]:
    """Returns the building's bounds as the page has them (y up, z south).

    They are west, floor, north, and east, ceiling, south.
    """
    west, south, east, north = bounds(world.floorplan.footprint)
    wall = max(wall.thickness_m for wall in world.floorplan.walls) / 2
    low = [west - wall, 0.0, -north - wall]
    return low, [east + wall, world.floorplan.ceiling_height_m, wall - south]


def write_pictures(
    world: World, bundle: Path, folder: Path, tell: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Writes pictures of a world: floor plan, view from above, and one for each room.

    Args:
        world: The world.
        bundle: Bundle of the world, whose preview is used if there is one.
        folder: Target folder, created if necessary.
        tell: Called with a line about each picture before it is drawn, as each may take a minute.

    Returns:
        The files: the plan, the view from above, then one for each room in the plan's order.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawings: dict[str, Callable[[], bytes]] = {
        PLAN_FILE: lambda: floorplan_svg(world).encode(),
        PREVIEW_FILE: lambda: preview_png(world, bundle),
    }
    for number, room in enumerate(world.floorplan.rooms, 1):
        name = f"room-{number}-{re.sub(r'[^A-Za-z0-9_-]+', '_', room.name)}.png"
        drawings[name] = partial(room_picture, world, room.name)
    for number, (name, draw) in enumerate(drawings.items(), 1):
        tell(f"picture {number} of {len(drawings)}: {name}")
        (folder / name).write_bytes(draw())
    return [folder / name for name in drawings]


def preview_png(world: World, bundle: Path) -> bytes:
    """Returns the picture (PNG) of a world from above: the one stored in its bundle, or a new one, not stored."""
    stored = bundle / PREVIEW_FILE
    return stored.read_bytes() if stored.is_file() else render_preview(world)
