"""Imports a floor plan drawing: reads it, furnishes the rooms, and checks the resulting world."""

import hashlib
from collections.abc import Callable, Mapping
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import NamedTuple

from ....schemas.templates.body import TemplateBuilding, TemplateFloor, WorldTemplateBody
from ....schemas.templates.drawing_notes import DrawingNotes
from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.world import DrawingForm, DrawnSource, World
from ..generator import furnish_and_prove
from .drawn_floorplan import ApartError, MadePlan, make_plan
from .drawn_shapes import Drawing
from .dxf import read_dxf
from .nav2_map import map_files, read_nav2_map
from .room_finding import metres_per_unit, read_plan
from .squaring import outline_area
from .svg import read_svg

MOST_BYTES = 20 * 1024 * 1024

_MOST_LOOKS = 20_000_000
"""Limit of (closed shapes' corners × texts) in a drawing, so that reading takes seconds.

An architect's sheet has a thousand of either.
"""

_MOST_OF_A_MAP = 0.8
"""Least share of a map's rooms that must be connected by doors, for an import with the other rooms left out.

Below it the import fails.
"""

Reader = Callable[[bytes, str], Drawing]

READERS: Mapping[str, tuple[DrawingForm, Reader]] = {".svg": ("svg", read_svg), ".dxf": ("dxf", read_dxf)}
"""Form of a drawing and the function that reads it, by the ending of the file's name."""

MAPS = (".yaml", ".yml")
"""File name suffixes of Nav2 maps that can be imported."""


class Source(NamedTuple):
    """The drawing and notes files that a world is imported from."""

    drawing: Path
    notes: Path | None = None
    """Path of the YAML file with notes beside a drawing; `None`: there is none."""


def import_world(source: Source, notes: DrawingNotes, seed: int, *, settle: bool = True) -> World:
    """Makes a world from a drawing or map: the floor plan is the drawing's, furniture is generated.

    Args:
        source: The drawing and the file of notes.
        notes: Scale, room types and wishes that the drawing does not have.
        seed: Seed of materials, furniture and undrawn windows; the same files and seed give the same world.
        settle: Whether physics runs for two seconds to see that loose objects stay.

    Raises:
        ConfigurationError: The file cannot be read, or draws no plan that a world can have.
        WorldGenerationError: No interior passed the checks.
    """
    read, scale, made, left_out = planned(source.drawing, notes, seed)
    origin = DrawnSource(
        file=source.drawing.name,
        sha256=read.sha256,
        form=read.form,
        metres_per_unit=read.cell_m or scale,
        outlines="faces" if made.on_faces else "centres",
        origin_m=made.origin_m,
        notes_sha256=hashlib.sha256(source.notes.read_bytes()).hexdigest() if source.notes else None,
        left_out=[*left_out, *read.drawing.left_out],
    )
    return furnish_and_prove(
        _body(notes), made.floorplan, (seed, seed), settle=settle, finish=lambda world: _finished(world, made, origin)
    )


def planned(path: Path, notes: DrawingNotes, seed: int) -> "tuple[ReadFile, float, MadePlan, list[str]]":
    """Reads a drawing or map and makes its floor plan, without furniture.

    Args:
        path: The drawing.
        notes: Scale, room types and wishes that the drawing does not have.
        seed: Seed of windows, if none are drawn.

    Returns:
        The file, metres a unit, the plan, and what was left out of it.

    Raises:
        ConfigurationError: The file cannot be read, or draws no plan that a world can have.
    """
    if path.suffix.lower() not in MAPS:
        return _planned(_read(path), path, notes, seed)
    try:
        return _planned(_read_map(path, coarse=False), path, notes, seed)
    except ConfigurationError:  # bumps and furniture
        return _planned(_read_map(path, coarse=True), path, notes, seed)


def _planned(
    read: "ReadFile", path: Path, notes: DrawingNotes, seed: int
) -> "tuple[ReadFile, float, MadePlan, list[str]]":
    _check(read.drawing, path.name)
    scale = metres_per_unit(read.drawing, notes.scale, path.name)
    plan, left_out = read_plan(read.drawing, scale, notes, path.name)
    try:
        return read, scale, make_plan(plan, notes.ceilingHeight, seed), left_out
    except ApartError as error:
        # A robot saw into it, and drove by: its door, if it is one, was too narrow or full of furniture.
        rooms = [room for room in plan.rooms if room.name not in error.rooms]
        kept, whole = (sum(outline_area(room.corners) for room in each) for each in (rooms, plan.rooms))
        if read.drawing.is_exact or kept < _MOST_OF_A_MAP * whole:
            raise
        left_out = [*left_out, f"{', '.join(error.rooms)}: no door leads there"]
        return read, scale, make_plan(plan._replace(rooms=rooms), notes.ceilingHeight, seed), left_out


class ReadFile(NamedTuple):
    """Content of a drawing or map file: its format, shapes and texts, SHA-256, and cell size of a map."""

    form: DrawingForm
    drawing: Drawing
    sha256: str
    cell_m: float | None = None


def _read_map(path: Path, *, coarse: bool) -> ReadFile:
    drawing, cell_m = read_nav2_map(path, coarse=coarse)
    digest = hashlib.sha256(b"".join(_content(each) for each in map_files(path))).hexdigest()
    return ReadFile("nav2-map", drawing, digest, cell_m)


def _read(path: Path) -> ReadFile:
    if path.suffix.lower() not in READERS:
        known = ", ".join([*READERS, f"{MAPS[0]} for a map"])
        raise ConfigurationError(f"{path}: a file that ends with {known} would be right")
    form, reader = READERS[path.suffix.lower()]
    content = _content(path)
    return ReadFile(form, reader(content, path.name), hashlib.sha256(content).hexdigest())


def _check(drawing: Drawing, name: str) -> None:
    """Checks that a drawing has finite coordinates, and that reading it would not take minutes.

    Raises ConfigurationError, which names the shape or says what is too much.
    """
    for shape in drawing.shapes:
        if not all(map(isfinite, chain.from_iterable(shape.points))):
            raise ConfigurationError(f"{name}: {shape.place} has a coordinate that is not finite")
    for label in drawing.labels:
        if not all(map(isfinite, label.at)):
            raise ConfigurationError(f"{name}: the text {label.text!r} has a coordinate that is not finite")
    corners = sum(len(shape.points) for shape in drawing.shapes if shape.closed)
    if corners * len(drawing.labels) > _MOST_LOOKS:
        raise ConfigurationError(
            f"{name}: its closed shapes have {corners:,} corners and it has {len(drawing.labels):,} texts, too many to "
            "find which text names which room; leave out the layers that are no part of the plan"
        )


def _finished(world: World, made: MadePlan, source: DrawnSource) -> World:
    """Returns the imported world with its doors as far open as they were drawn."""
    passages = [
        passage.model_copy(update={"door": passage.door.model_copy(update={"open_percent": made.open_percents[index]})})
        if passage.door and index in made.open_percents
        else passage
        for index, passage in enumerate(world.floorplan.passages)
    ]
    plan = world.floorplan.model_copy(update={"passages": passages})
    return world.model_copy(update={"floorplan": plan, "source": source})


def _body(notes: DrawingNotes) -> WorldTemplateBody:
    return WorldTemplateBody(Version="2", Buildings=[TemplateBuilding(Floors=[TemplateFloor(Interior=notes.interior)])])


def _content(path: Path) -> bytes:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ConfigurationError(f"{path}: it is larger than {MOST_BYTES // 2**20} MiB")
        return path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"{path}: it cannot be read: {error.strerror}") from error
