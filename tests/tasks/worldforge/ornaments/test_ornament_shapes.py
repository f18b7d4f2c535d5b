"""Procedural shapes: closed, seen from outside, as large as they are asked for, and cheap."""

from collections import Counter

import numpy as np
import pytest

from prefect_robomaker.tasks.worldforge.furniture.catalogue import CATALOGUE
from prefect_robomaker.tasks.worldforge.geometry.parts import Vector
from prefect_robomaker.tasks.worldforge.ornaments.ornament_shapes import FORMS, Shapes, form_of

SIZES: tuple[Vector, ...] = ((0.3, 0.2, 0.1), (0.1, 0.3, 0.2), (0.2, 0.1, 0.3))
OUT_OF_THE_BOX = ("mug",)
"""Its ear: what collides is the cup alone."""


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("size", SIZES, ids=["low", "wide", "tall"])
def test_it_is_closed_and_fills_its_box(form: str, size: Vector) -> None:
    mesh = FORMS[form](size)
    assert len(mesh.triangles) <= 320
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    for axis in (0, 2) if form in OUT_OF_THE_BOX else range(3):
        assert (low[axis], high[axis]) == pytest.approx((-size[axis] / 2, size[axis] / 2), abs=0.02 * size[axis])
    # Each edge is in two triangles, once in each direction; corners of sharp edges are there more than once.
    places = {tuple(point): index for index, point in enumerate(np.round(mesh.vertices, 9).tolist())}
    ids = [places[tuple(point)] for point in np.round(mesh.vertices, 9).tolist()]
    edges = Counter(
        (ids[int(a)], ids[int(b)])
        for triangle in mesh.triangles
        for a, b in zip(triangle, np.roll(triangle, -1), strict=True)
        if ids[int(a)] != ids[int(b)]
    )
    assert all(count == edges[b, a] for (a, b), count in edges.items())
    corners = mesh.vertices[mesh.triangles]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume > 0


def test_a_shape_is_made_once_for_each_size() -> None:
    shapes = Shapes()
    assert shapes.named("bowl", (0.2, 0.2, 0.1)) == shapes.named("bowl", (0.2, 0.2, 0.1))
    assert shapes.named("bowl", (0.2, 0.2, 0.1)) != shapes.named("bowl", (0.3, 0.3, 0.1))
    assert len(list(shapes.lines())) == 2


def test_plants_are_no_balls_and_round_parts_stay_round() -> None:
    for kind, entry in CATALOGUE.items():
        for style in entry.styles:
            for part in entry.build(style):
                form = form_of(kind, part)
                if part.name.startswith(("plant", "bunch")):
                    assert form in ("bush", "sprigs")
                if part.shape == "cylinder":
                    assert form not in ("block", "bevel", "soft", "padded")
