"""Writes and reads world bundles: a folder per world, addressed by the hash of its content."""

import hashlib
import shutil
import tempfile
from pathlib import Path

from ....schemas.worlds.description import DESCRIPTION_FILE
from ....schemas.worlds.world import World
from ..doors.leaves import leaf_outlines
from ..geometry.occupancy import occupancy_grid, write_map
from ..materials.textures import texture_png, texture_size_m
from ..model.description import description_text
from ..model.mjcf import TEXTURES_FOLDER, surfaces, world_mjcf
from ..pictures.plan_svg import floorplan_svg
from ..pictures.preview import render_preview

WORLD_FILE = "world.json"
MODEL_FILE = "world.xml"
PLAN_FILE = "floorplan.svg"
PREVIEW_FILE = "preview.png"


def write_bundle(world: World, folder: Path, *, preview: bool = True) -> str:
    """Writes a world's bundle; the folder appears whole or not at all.

    Args:
        world: the world.
        folder: where; must not exist, its parent is made if need be.
        preview: whether to draw `preview.png`, the slowest part.

    Returns:
        The content's hash, hexadecimal: of all names and bytes but the preview's.

    Raises:
        FileExistsError: there is something at `folder` already.
    """
    if folder.exists():
        raise FileExistsError(f"{folder}: exists already; a bundle is written once, into a new folder")
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        _write_files(world, temporary, preview)
        content = content_hash(temporary)
        # Made private by mkdtemp; a bundle is as readable as any other folder.
        temporary.chmod(0o755)
        temporary.rename(folder)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    return content


def read_world(folder: Path) -> World:
    """Reads the world of a bundle.

    Raises:
        FileNotFoundError: the folder holds no `world.json`.
        ValueError: the file is no world, or one of another version's form.
    """
    return World.model_validate_json((folder / WORLD_FILE).read_bytes())


def content_hash(folder: Path) -> str:
    """SHA-256 over the names and bytes of a bundle's files; the preview is left out, being only a picture."""
    digest = hashlib.sha256()
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    for name in sorted(files):
        if name != PREVIEW_FILE:
            content = files[name].read_bytes()
            digest.update(f"{name}\0{len(content)}\0".encode())
            digest.update(content)
    return digest.hexdigest()


def _write_files(world: World, folder: Path, preview: bool) -> None:
    (folder / WORLD_FILE).write_text(world.model_dump_json(indent=1) + "\n", encoding="utf-8")
    (folder / MODEL_FILE).write_text(world_mjcf(world, textured=True), encoding="utf-8")
    _write_textures(world, folder / TEXTURES_FOLDER)
    (folder / PLAN_FILE).write_text(floorplan_svg(world), encoding="utf-8")
    write_map(occupancy_grid(world.floorplan, world.furniture, leaf_outlines(world.floorplan)), folder)
    (folder / DESCRIPTION_FILE).write_text(description_text(world), encoding="utf-8")
    if preview:
        (folder / PREVIEW_FILE).write_bytes(render_preview(world))


def _write_textures(world: World, folder: Path) -> None:
    folder.mkdir()
    for name in surfaces(world):
        if texture_size_m(name) is not None:
            (folder / f"{name}.png").write_bytes(texture_png(name))
