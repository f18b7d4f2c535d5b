"""The catalogue of furniture: complete, well-sized, cheap to simulate, free of flicker."""

import itertools
import re

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.worlds.world import MODEL_TYPES, Furniture
from prefect_robomaker.tasks.worldforge.furniture.catalogue import LOOSE_TYPES, parts_of, styles_of
from prefect_robomaker.tasks.worldforge.furniture.usual_furniture import RULES
from prefect_robomaker.tasks.worldforge.geometry.parts import BEARING_M, Part, Style

LOOKS = [(kind, style) for kind in (*MODEL_TYPES, *LOOSE_TYPES) for style in styles_of(kind)]
FORMS = list({(kind, style.form): (kind, style) for kind, style in LOOKS}.values())


def name_of(value: object) -> str:
    return value.name if isinstance(value, Style) else str(value)


def furniture(kind: str, style: Style) -> Furniture:
    return Furniture(
        id=f"{kind}_1",
        model_type=kind,
        style=style.name,
        room="room",
        x=0.0,
        y=0.0,
        yaw=0.0,
        width_m=style.width_m,
        depth_m=style.depth_m,
        height_m=style.height_m,
    )


def bounds(part: Part) -> list[tuple[float, float]]:
    return [(c - s / 2, c + s / 2) for c, s in zip(part.center, part.size, strict=True)]


def test_every_model_type_of_the_service_can_be_built_and_placed() -> None:
    assert set(RULES) == set(MODEL_TYPES)
    assert len(MODEL_TYPES) >= 31  # the service's
    for kind in MODEL_TYPES:
        names = [style.name for style in styles_of(kind)]
        assert names
        assert len(set(names)) == len(names)


def test_all_types_come_in_several_looks() -> None:
    assert min(len(styles_of(kind)) for kind in MODEL_TYPES) >= 2
    assert sum(len(styles_of(kind)) for kind in MODEL_TYPES) >= 150


@pytest.mark.parametrize(("kind", "style"), LOOKS, ids=name_of)
def test_parts_fill_the_footprint_and_stay_on_it(kind: str, style: Style) -> None:
    parts = parts_of(furniture(kind, style))
    assert len({part.name for part in parts}) == len(parts)
    for axis, extent in ((0, style.depth_m), (1, style.width_m)):
        low = min(bounds(part)[axis][0] for part in parts)
        high = max(bounds(part)[axis][1] for part in parts)
        assert -0.51 * extent - 0.005 <= low <= -0.46 * extent
        assert 0.46 * extent <= high <= 0.51 * extent + 0.005
    assert 0 <= min(bounds(part)[2][0] for part in parts) <= 0.021


@pytest.mark.parametrize(("kind", "style"), LOOKS, ids=name_of)
def test_collision_is_cheap_and_as_high_as_the_piece(kind: str, style: Style) -> None:
    parts = parts_of(furniture(kind, style))
    solid = [part for part in parts if part.solid]
    assert 1 <= len(solid) <= 7
    assert len(parts) <= 30
    assert max(bounds(part)[2][1] for part in solid) >= 0.45 * style.height_m


@pytest.mark.parametrize(("kind", "style"), FORMS, ids=name_of)
def test_what_is_put_on_a_piece_stands_where_it_is_drawn(kind: str, style: Style) -> None:
    """Where the highest part drawn is level and large, something solid is as high; cushions give two centimetres."""
    parts = parts_of(furniture(kind, style))
    levels = [
        part for part in parts if part.drawn and flat(part, 2) and min(part.size[:2]) > 0.3 and part.name != "throw"
    ]
    for level in levels:
        spot = (level.center[0] + 0.11, level.center[1] + 0.12)
        over = [bounds(part)[2][1] for part in parts if part.drawn and covers(part, spot)]
        if max(over) > bounds(level)[2][1] + 1e-6:
            continue
        carried = max(bounds(part)[2][1] for part in parts if part.solid and covers(part, spot))
        assert -1.1 * BEARING_M <= max(over) - carried <= 0.026, level.name


@pytest.mark.parametrize(("kind", "style"), FORMS, ids=name_of)
def test_plinths_stop_what_is_low(kind: str, style: Style) -> None:
    parts = parts_of(furniture(kind, style))
    for plinth in (part for part in parts if part.name == "plinth" and part.size[2] > 0.04):
        (_, front), (right, left), _ = bounds(plinth)
        low = [bounds(part) for part in parts if part.solid and bounds(part)[2][0] < 0.01]
        for spot in ((front, 0.0), (0.0, left), (0.0, right)):
            stopped = [(x, y) for x, y, _ in low if x[0] <= spot[0] <= x[1] and y[0] <= spot[1] <= y[1]]
            assert stopped, spot
            assert max(x[1] for x, _ in stopped) - front <= 0.061, "not long before it is reached"


def covers(part: Part, spot: tuple[float, float]) -> bool:
    (x0, x1), (y0, y1), _ = bounds(part)
    return x0 <= spot[0] <= x1 and y0 <= spot[1] <= y1


@pytest.mark.parametrize(("kind", "style"), FORMS, ids=name_of)
def test_no_two_faces_of_different_colour_lie_in_one_plane(kind: str, style: Style) -> None:
    flickering = [
        (a.name, b.name, axis, end)
        for a, b in itertools.combinations(filter(is_drawn, parts_of(furniture(kind, style))), 2)
        if a.color != b.color
        for axis in range(3)
        for end in (0, 1)
        if flat(a, axis) and flat(b, axis) and in_one_plane(bounds(a), bounds(b), axis, end)
    ]
    # Faces that look down cannot be seen.
    assert [entry for entry in flickering if entry[2:] != (2, 0)] == []


def is_drawn(part: Part) -> bool:
    return part.drawn


def flat(part: Part, axis: int) -> bool:
    return part.shape == "box" or (part.shape == "cylinder" and "xyz"[axis] == part.axis)


def in_one_plane(a: list[tuple[float, float]], b: list[tuple[float, float]], axis: int, end: int) -> bool:
    others = [other for other in range(3) if other != axis]
    shared = min(min(a[i][1], b[i][1]) - max(a[i][0], b[i][0]) for i in others)
    return abs(a[axis][end] - b[axis][end]) < 5e-4 and shared > 1e-3


def test_a_style_of_another_version_is_named_in_the_error() -> None:
    known = styles_of("Sofas")[0]
    with pytest.raises(ValueError, match=r"style 'nine-seat pink' of Sofas.*three-seat grey"):
        parts_of(furniture("Sofas", known).model_copy(update={"style": "nine-seat pink"}))
    with pytest.raises(ValueError, match="model_type 'Pianos'"):
        parts_of(furniture("Sofas", known).model_copy(update={"model_type": "Pianos"}))


_LOOSE = {"cups": "Cup", "plates": "Plate"}
"""Words of the page for kinds that no template names."""


@pytest.mark.parametrize("shape", ["cylinder", "ellipsoid"])
def test_the_page_names_all_that_mjx_in_jax_refuses_beside_boxes(shape: str) -> None:
    page = (REPOSITORY / "docs" / "worlds-export.md").read_text()
    (row,) = re.findall(rf"^\| {shape} \| (.*) \|$", page, re.MULTILINE)
    named = {*re.findall(r"`(\w+)`", row), *(kind for word, kind in _LOOSE.items() if word in row)}
    # Ellipsoids with three equal axes are written as spheres.
    found = {
        kind
        for kind, style in LOOKS
        for part in parts_of(furniture(kind, style))
        if part.solid and part.shape == shape and (shape == "cylinder" or len({*part.size}) > 1)
    }
    assert named == found
