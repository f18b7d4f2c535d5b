"""All pictures of a world as files: the plan, the view from above, and one from inside each room."""

import re
from pathlib import Path

from ....schemas.worlds.world import World
from ..bundle.bundle import PLAN_FILE, PREVIEW_FILE
from ..pictures.plan_svg import floorplan_svg
from ..pictures.preview import render_preview
from ..pictures.room_picture import room_picture


def write_pictures(world: World, bundle: Path, folder: Path) -> list[Path]:
    """Writes the pictures; those that are there already are replaced.

    Args:
        world: the world.
        bundle: its bundle, whose preview is taken if there is one.
        folder: where to; made if need be.

    Returns:
        The files: the plan, the view from above, then one for each room in the plan's order.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plan, preview = folder / PLAN_FILE, folder / PREVIEW_FILE
    plan.write_text(floorplan_svg(world), encoding="utf-8")
    preview.write_bytes(preview_png(world, bundle))
    written = [plan, preview]
    for number, room in enumerate(world.floorplan.rooms, 1):
        path = folder / f"room-{number}-{re.sub(r'[^A-Za-z0-9_-]+', '_', room.name)}.png"
        path.write_bytes(room_picture(world, room.name))
        written.append(path)
    return written


def preview_png(world: World, bundle: Path) -> bytes:
    """The world from above: the bundle's picture, or a new one where it was left out."""
    stored = bundle / PREVIEW_FILE
    return stored.read_bytes() if stored.is_file() else render_preview(world)
