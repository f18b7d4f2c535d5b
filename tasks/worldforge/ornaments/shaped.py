"""Furniture as it is drawn: parts as procedural shapes, shelves with single books."""

from collections.abc import Iterator
from random import Random

from ....schemas.worlds.world import Furniture
from ..furniture.catalogue import parts_of
from ..furniture.solids import Solid, solids_of
from ..geometry.parts import Part
from .books import book_row
from .forms import Shapes, form_of
from .ornaments import Ornament


def shaped(item: Furniture, shapes: Shapes) -> Iterator[tuple[Solid, list[Ornament]]]:
    """A piece's parts, each with what is drawn in its place; nothing: it is drawn as it is."""
    for part, solid in zip(parts_of(item), solids_of(item), strict=True):
        if item.model_type == "Bookcases" and part.name.startswith("books-"):
            yield solid, list(_books(item, part, solid, shapes))
            continue
        form = form_of(item.model_type, part)
        name = f"{solid.name}_seen" if part.solid else solid.name
        yield solid, [shapes.drawn(name, form, part.size, solid.center, part.color, item.yaw)] if form else []


def _books(item: Furniture, part: Part, solid: Solid, shapes: Shapes) -> Iterator[Ornament]:
    dice = Random(f"{item.id} {item.style} {part.name}")  # noqa: S311 (chance, not secrecy)
    x, y, z = solid.center
    name = f"book_{item.id}_{part.name.removeprefix('books-').replace('-', '_')}"
    return book_row(name, (x, y, z - part.size[2] / 2), item.yaw, part.size, shapes, dice)
