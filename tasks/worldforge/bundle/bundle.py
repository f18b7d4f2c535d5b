"""Writes and reads world bundles: one folder of files per world, identified by a hash of its content."""

import hashlib
import re
import shutil
import tempfile
from collections.abc import Mapping
from itertools import chain, count
from pathlib import Path
from typing import NamedTuple

from ....schemas.worlds.appearance import DAY, appearance_named, relit
from ....schemas.worlds.description import DESCRIPTION_FILE
from ....schemas.worlds.world import PREVIEW_FILE, WORLD_FILE, World
from ..doors.door_parts import leaf_outlines
from ..geometry.occupancy import map_files, occupancy_grid
from ..materials.texture_files import texture_png
from ..materials.textures import SKY, texture_size_m
from ..model.description import description_text
from ..model.mjcf import TEXTURES_FOLDER, decorated_mjcf, surfaces
from ..pictures.plan_svg import floorplan_svg

MODEL_FILE = "world.xml"
PLAN_FILE = "floorplan.svg"


def write_bundle(world: World, folder: Path) -> str:
    """Writes the files of a generated world to a folder: `world.json`, MJCF model, meshes and occupancy map.

    The preview picture takes longer than all of these together, so it is drawn only when somebody looks at the world.

    Args:
        world: The world.
        folder: Target folder, which must not exist; its parent is created if necessary.

    Returns:
        The content's hash, hexadecimal: of all names and bytes.

    Raises:
        FileExistsError: There is something at `folder` already.
    """
    return write_files(_files(world), folder)


def write_files(files: Mapping[str, bytes], folder: Path) -> str:
    """Writes the files of a world to a new folder, all or none; returns their hash.

    Args:
        files: Contents by their paths in the bundle.
        folder: Target folder, which must not exist; its parent is created if necessary.

    Returns:
        The content's hash, hexadecimal: of all names and bytes.

    Raises:
        FileExistsError: There is something at `folder` already.
    """
    if folder.exists():
        raise FileExistsError(f"{folder}: exists already; a bundle is written once, into a new folder")
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        for inner in {(temporary / name).parent for name in files}:
            inner.mkdir(exist_ok=True)
        for name, content in files.items():
            (temporary / name).write_bytes(content)
        # Made private by mkdtemp; a bundle is as readable as any other folder.
        temporary.chmod(0o755)
        temporary.rename(folder)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    return _hash(files)


def read_world(folder: Path) -> World:
    """Reads a world from its folder of files.

    Raises:
        FileNotFoundError: The folder holds no `world.json`.
        ValueError: The file is no world, or one of another version's form.
    """
    return World.model_validate_json((folder / WORLD_FILE).read_bytes())


def content_hash(folder: Path) -> str:
    """Returns the SHA-256 over a world's files and their paths, in hexadecimal digits, without the preview picture."""
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return _hash({name: path.read_bytes() for name, path in files.items() if name != PREVIEW_FILE})


def _hash(files: Mapping[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name, content in sorted(files.items()):
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def _files(world: World) -> dict[str, bytes]:
    """Returns the content of all files of a world's bundle, by their paths in the bundle."""
    model, meshes = decorated_mjcf(world)
    if world.appearance != DAY:
        model = relit(model, appearance_named(world.appearance))
    texts = {
        WORLD_FILE: world.to_text(),
        MODEL_FILE: model,
        **meshes,
        PLAN_FILE: floorplan_svg(world),
        DESCRIPTION_FILE: description_text(world),
    }
    grid = occupancy_grid(world.floorplan, world.furniture, leaf_outlines(world.floorplan))
    return {**{name: text.encode() for name, text in texts.items()}, **_textures(world), **map_files(grid)}


def _textures(world: World) -> dict[str, bytes]:
    pictured = [*(name for name in surfaces(world) if texture_size_m(name) is not None), SKY]
    return {f"{TEXTURES_FOLDER}/{name}.png": texture_png(name) for name in pictured}


NAMES_FILE = "names.json"

_PLAIN = re.compile(r"[A-Za-z0-9_]+")
_NAMED = re.compile(r'\sname="([^"]+)"')
_ATTRIBUTE = re.compile(r'(\s(\w+)=")([^"]*)(?=")')


class PlainModel(NamedTuple):
    """An MJCF model whose names contain only letters, digits and `_`."""

    mjcf: str
    names: Mapping[str, str]
    """Names as `world.json` and the other files have them, by the plain name that replaces them.

    It has only names that differ.
    """


def with_plain_names(mjcf: str) -> PlainModel:
    """Replaces special characters in an MJCF model's names by `_`, keeping names unique.

    Args:
        mjcf: The text of a model.
    """
    names = dict.fromkeys(_NAMED.findall(mjcf))
    plain = {name: name for name in names if _PLAIN.fullmatch(name)}
    taken = set(plain)
    for name in names:
        if name not in plain:
            short = re.sub(r"[^A-Za-z0-9_]", "_", name)
            numbered = (f"{short}_{number}" for number in count(2))
            plain[name] = next(each for each in chain([short], numbered) if each not in taken)
            taken.add(plain[name])
    text = _ATTRIBUTE.sub(lambda at: at[1] + (at[3] if at[2] == "file" else plain.get(at[3], at[3])), mjcf)
    return PlainModel(text, {new: name for name, new in plain.items() if new != name})
