"""Writes and reads world bundles: a folder per world, addressed by the hash of its content."""

import hashlib
import shutil
import tempfile
from pathlib import Path

from ....schemas.worlds.appearance import DAY, appearance_named, relit
from ....schemas.worlds.description import DESCRIPTION_FILE
from ....schemas.worlds.world import World
from ..doors.leaves import leaf_outlines
from ..geometry.occupancy import occupancy_grid, write_map
from ..materials.sky import SKY, sky_png
from ..materials.textures import texture_png, texture_size_m
from ..model.description import description_text
from ..model.mjcf import TEXTURES_FOLDER, decorated_mjcf, surfaces
from ..pictures.plan_svg import floorplan_svg

WORLD_FILE = "world.json"
MODEL_FILE = "world.xml"
PLAN_FILE = "floorplan.svg"
PREVIEW_FILE = "preview.png"
"""Only in bundles of earlier releases, and in exports."""


def write_bundle(world: World, folder: Path) -> str:
    """Writes a world's bundle; the folder appears whole or not at all.

    A preview takes longer than all of it, and is drawn when somebody looks at the world.

    Args:
        world: the world.
        folder: where; must not exist, its parent is made if need be.

    Returns:
        The content's hash, hexadecimal: of all names and bytes.

    Raises:
        FileExistsError: there is something at `folder` already.
    """
    if folder.exists():
        raise FileExistsError(f"{folder}: exists already; a bundle is written once, into a new folder")
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        _write_files(world, temporary)
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


def _write_files(world: World, folder: Path) -> None:
    (folder / WORLD_FILE).write_text(world.to_text(), encoding="utf-8")
    model, meshes = decorated_mjcf(world)
    if world.appearance != DAY:
        model = relit(model, appearance_named(world.appearance))
    (folder / MODEL_FILE).write_text(model, encoding="utf-8")
    for path, text in meshes.items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    _write_textures(world, folder / TEXTURES_FOLDER)
    (folder / PLAN_FILE).write_text(floorplan_svg(world), encoding="utf-8")
    write_map(occupancy_grid(world.floorplan, world.furniture, leaf_outlines(world.floorplan)), folder)
    (folder / DESCRIPTION_FILE).write_text(description_text(world), encoding="utf-8")


def _write_textures(world: World, folder: Path) -> None:
    folder.mkdir()
    for name in surfaces(world):
        if texture_size_m(name) is not None:
            (folder / f"{name}.png").write_bytes(texture_png(name))
    (folder / f"{SKY}.png").write_bytes(sky_png())
