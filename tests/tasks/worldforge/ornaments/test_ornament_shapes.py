"""Procedural shapes: closed, seen from outside, as large as they are asked for, and cheap."""

import hashlib
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.worldforge.furniture.catalogue import CATALOGUE
from prefect_robomaker.tasks.worldforge.geometry.parts import Vector
from prefect_robomaker.tasks.worldforge.ornaments.ornament_shapes import FORMS, Shapes, form_of
from prefect_robomaker.tasks.worldforge.ornaments.ornaments import number_texts, numbers

SIZES: tuple[Vector, ...] = ((0.3, 0.2, 0.1), (0.1, 0.3, 0.2), (0.2, 0.1, 0.3))
OUT_OF_THE_BOX = ("mug",)
"""Its ear: what collides is the cup alone."""
UNEVEN = (0.0621, 0.08705, 0.01245)
"""Coordinates of halves of this lie in the middle between two written numbers."""
DIGESTS = {
    "block": "13dda0471c43",
    "bevel": "b438ed72e861",
    "padded": "0a0b92e52f46",
    "soft": "fb9e03d7a071",
    "cushion": "09f6da61925d",
    "crumpled": "075d8ac0a2b5",
    "bush": "7f80658cc7a5",
    "sprigs": "8ff8816fd768",
    "flowers": "f1f33aba0e0b",
    "fruit": "93000437cedd",
    "kettle": "caee1b4b1cc6",
    "pan": "6ecae6a5ec1a",
    "draped": "56d109219e3e",
    "curtain": "42c718129ea9",
    "mug": "a1b548ad0853",
    "pot": "8df925a6a9c6",
    "vase": "3477ba60e6ec",
    "bottle": "93bdb2c8bb75",
    "jar": "9631f8256c1a",
    "bowl": "f04fb7287a4f",
    "plate": "6601657b5bd5",
    "shade": "dac3e8690163",
    "glass": "1f09e7eac924",
    "lamp": "d740d312da35",
    "ball": "339888629961",
}
"""First digits of the SHA-256 of each form's mesh at `SIZES` and `UNEVEN`, as generators 3.0 to 3.3 write it."""


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


@pytest.mark.parametrize("form", FORMS)
def test_its_bytes_are_those_of_worlds_that_there_are(form: str) -> None:
    """Another text is another bundle: it takes another version of the generator."""
    texts = "\n".join(FORMS[form](size).line(form) for size in (*SIZES, UNEVEN))
    assert hashlib.sha256(texts.encode()).hexdigest()[:12] == DIGESTS[form]


@pytest.mark.parametrize("form", FORMS)
def test_a_mesh_is_the_same_whatever_was_made_before(form: str) -> None:
    """Arrays that meshes of a form share are read-only."""
    first = FORMS[form](SIZES[0])
    text = first.line(form)
    first.vertices[:] = 0.0
    if first.triangles.flags.writeable:
        first.triangles[:] = 0
    FORMS[form](SIZES[1])
    assert FORMS[form](SIZES[0]).line(form) == text


_TICKS = st.integers(-10_000_000, 10_000_000)


@given(st.lists(st.one_of(st.floats(-1e4, 1e4), _TICKS.map(lambda tick: (tick + 0.5) / 1e4)), min_size=1))
def test_many_numbers_are_written_as_one_is(values: list[float]) -> None:
    """Also those in the middle between two, which a product rounds to the wrong side."""
    assert " ".join(number_texts(np.array(values))) == numbers(*values)
