"""Checks a stored world again from its files.

It measures the world's model, and compares map, description and manifest with it.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from PIL import Image, UnidentifiedImageError
from pydantic import ValidationError

from ....schemas.worlds.description import DESCRIPTION_FILE, WorldDescription
from ....schemas.worlds.world import PREVIEW_FILE, Fault, GazeboSource, Guarantee, World, WorldChecks
from ..geometry.occupancy import FREE_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL, OccupancyGrid, map_files
from ..model.description import describe, description_text
from ..pictures.plan_svg import floorplan_svg
from ..proofs.checks import Site, awake_scan, check_world, planned_site
from ..proofs.guarantees import REST_S, SETTLE_S
from ..proofs.maps import lidar_faults, map_faults
from ..proofs.parts import part_faults
from ..seeds import GENERATOR_VERSION
from .bundle import MODEL_FILE, PLAN_FILE
from .robot_map import MAP_FILES
from .survey import ground_at, in_the_way, known_map

_PIXELS = (OCCUPIED_PIXEL, FREE_PIXEL, UNKNOWN_PIXEL)
_NOT_OF_THE_WORLD = {PREVIEW_FILE, "manifest.json"}
"""Files that are added to a world's bundle after it was stored, and so are missing in its manifest."""
_UNCOMPARED = {"contentHash", "proofs"}
"""Members of a world's description file that are not compared with `world.json`.

They say nothing about the world itself.
"""

_LESS_COMPARED: dict[Guarantee, str] = {
    "parts": "not compared: an earlier generator's parts are compared by outline only",
    "description": "not compared: an earlier generator's floor plan is not drawn again",
}
"""Reasons why a world that names another generator does not pass as one of this generator's does."""


def prove(world: World, folder: Path, *, digests: Mapping[str, str] | None = None, pushed: bool = False) -> WorldChecks:
    """Measures a stored world again, whichever generator version made it, and whether it was generated or imported.

    Args:
        world: The world.
        folder: Folder of the world's bundle.
        digests: SHA-256 of its files by their paths, from the manifest it was stored with; absent if it has none.
        pushed: Whether loose objects are pushed, too.

    Returns:
        The measurements, with all places where a guarantee is broken.

    Raises:
        ValueError: When MuJoCo does not accept the model.
    """
    model = mujoco.MjModel.from_xml_path(str(folder / MODEL_FILE))
    site = _seen_site(world, model) if isinstance(world.source, GazeboSource) else planned_site(world, model)
    settle_s = SETTLE_S if site.is_planned else REST_S
    checks = check_world(world, site, settle_s=settle_s, pushed=pushed, placed=True)
    parts = part_faults(world, site.scan)
    faults = [
        *(checks.faults or []),
        *parts,
        *_map_faults(world, site, folder, as_described=not parts),
        *_description_faults(world, folder),
        *_file_faults(folder, digests),
    ]
    absent: dict[Guarantee, str] = {} if site.is_planned else {"doors": "world.json of imported worlds has none"}
    if site.is_planned and world.generator_version != GENERATOR_VERSION:
        absent |= _LESS_COMPARED
    if digests is None:
        absent["files"] = "the folder has no manifest with digests"
    return checks.model_copy(update={"faults": faults, "not_compared": absent})


def _seen_site(world: World, model: mujoco.MjModel) -> Site:
    """Returns the place to be checked of an imported world, with the map of the area that is seen from the start."""
    scan = awake_scan(world, model)
    ground = ground_at(model, scan.data)
    grid = known_map(ground, (0.0, 0.0))
    return Site(scan, grid, grid, in_the_way(ground, (0.0, 0.0)) is None, is_planned=False)


def _map_faults(world: World, site: Site, folder: Path, *, as_described: bool) -> Iterator[Fault]:
    """Yields the differences between a world's stored map and its model, and other obstacles that a lidar would hit.

    A map that cannot be read is a fault; the model's own map then stands in for it.
    """
    try:
        read = _read_map(folder, site.first)
    except ValueError as error:
        yield Fault.placed("map", str(error))
        read = site.first
    yield from map_faults(world, site, read, as_described=as_described)
    yield from lidar_faults(world, site, read)


def _read_map(folder: Path, wanted: OccupancyGrid) -> OccupancyGrid:
    """Reads the occupancy map of a bundle, and checks its metadata (resolution, origin, thresholds).

    Raises ValueError if the metadata is not that of the wanted grid, or the picture cannot be read.
    """
    said, right = ((_lines(text)) for text in (_text(folder / MAP_FILES[1]), map_files(wanted)[MAP_FILES[1]].decode()))
    for line, better in zip(said, right, strict=False):
        if line != better:
            raise ValueError(f"map.yaml says {line!r}; {better!r} would be right")
    if len(said) != len(right):
        raise ValueError(f"map.yaml has {len(said)} members; {len(right)} would be right")
    try:
        with Image.open(folder / MAP_FILES[0]) as picture:
            pixels = np.asarray(picture.convert("L"))[::-1]
    except (OSError, UnidentifiedImageError) as error:
        raise ValueError(f"map.pgm cannot be read: {error}") from error
    if not np.isin(pixels, _PIXELS).all():
        raise ValueError(f"map.pgm has pixels that are none of {', '.join(map(str, _PIXELS))}")
    return OccupancyGrid(wanted.origin, pixels == OCCUPIED_PIXEL, pixels != UNKNOWN_PIXEL, wanted.resolution_m)


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path.name} cannot be read: {error}") from error


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def _description_faults(world: World, folder: Path) -> Iterator[Fault]:
    """Yields the differences between the description for other programs and `world.json`.

    A floor plan picture that shows another world counts, too.
    """
    is_ours = world.generator_version == GENERATOR_VERSION
    if is_ours and _plan(folder) != floorplan_svg(world):
        yield Fault.placed("description", f"{PLAN_FILE} is not the plan of this world")
    try:
        text = _text(folder / DESCRIPTION_FILE)
        if is_ours and text == description_text(world):
            return
        found = WorldDescription.model_validate_json(text)
    except (ValueError, ValidationError) as error:
        yield Fault.placed("description", f"{DESCRIPTION_FILE} cannot be read: {str(error).splitlines()[0]}")
        return
    # Descriptions of earlier generators do not say which plan it is.
    left_out = _UNCOMPARED if is_ours else {*_UNCOMPARED, "plan"}
    said, right = (each.model_dump(mode="json", exclude=left_out) for each in (found, describe(world)))
    if (place := _difference(said, right)) is not None:
        yield Fault.placed("description", f"{DESCRIPTION_FILE} is not as world.json: {place}")


def _plan(folder: Path) -> str | None:
    try:
        return (folder / PLAN_FILE).read_text()
    except (OSError, UnicodeDecodeError):
        return None


def _difference(said: Any, right: Any, path: str = "") -> str | None:
    """Describes the first member in which two descriptions of a world differ, with both values.

    Returns `None` if they are equal.
    """
    if isinstance(said, dict) and isinstance(right, dict):
        pairs = ((f"{path}.{key}".strip("."), said.get(key), right.get(key)) for key in sorted({*said, *right}))
    elif isinstance(said, list) and isinstance(right, list):
        if len(said) != len(right):
            return f"{path} has {len(said)} members, not {len(right)}"
        pairs = ((f"{path}[{index}]", *two) for index, two in enumerate(zip(said, right, strict=True)))
    else:
        return None if said == right else f"{path} is {said!r}, not {right!r}"
    return next((found for place, *two in pairs if (found := _difference(two[0], two[1], place))), None)


def _file_faults(folder: Path, digests: Mapping[str, str] | None) -> Iterator[Fault]:
    """Yields the files of a bundle that differ from the manifest's SHA-256, and missing or additional files.

    Without digests nothing is checked.
    """
    if digests is None:
        return
    found = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    for name in sorted((digests.keys() | found.keys()) - _NOT_OF_THE_WORLD):
        if name not in found:
            yield Fault.placed("files", f"{name} is missing, which the manifest has")
        elif name not in digests:
            yield Fault.placed("files", f"{name} is not in the manifest")
        elif hashlib.sha256(found[name].read_bytes()).hexdigest() != digests[name]:
            yield Fault.placed("files", f"{name} is another file than the manifest has")
