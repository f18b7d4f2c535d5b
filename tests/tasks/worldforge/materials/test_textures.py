"""Textures: seamless, small, the same in every process, and different from each other."""

import hashlib
import io
import itertools
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from prefect_robomaker.schemas.worlds.world import FLOOR_MATERIALS, WALL_MATERIALS
from prefect_robomaker.tasks.worldforge.materials.materials import FLOORS, WALLS, finish_named, surface_finish
from prefect_robomaker.tasks.worldforge.materials.textures import (
    mean_color,
    sample,
    texture,
    texture_png,
    texture_size_m,
)

NAMES = [
    f"{surface}_{material}_{finish.name}"
    for surface, table in (("floor", FLOORS), ("wall", WALLS))
    for material in table
    for finish in table[material].finishes
]
TEXTURED = [name for name in NAMES if texture_size_m(name) is not None]


def test_every_material_has_several_finishes() -> None:
    assert set(FLOORS) == set(FLOOR_MATERIALS)
    assert set(WALLS) == set(WALL_MATERIALS)
    for material in (*FLOORS.values(), *WALLS.values()):
        assert len({finish.name for finish in material.finishes}) == len(material.finishes) >= 2


def test_only_paint_is_plain() -> None:
    assert {name.split("_")[1] for name in set(NAMES) - set(TEXTURED)} == {"WallPaint"}


@pytest.mark.parametrize("name", TEXTURED)
def test_a_picture_is_small_and_reads_back(name: str) -> None:
    data = texture_png(name)
    assert len(data) < 64_000
    picture = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(float)
    assert picture.shape == texture(name).shape
    assert max(picture.shape) <= 384
    assert np.abs(picture - texture(name)).mean() < 6


@pytest.mark.parametrize("name", TEXTURED)
def test_there_is_no_seam(name: str) -> None:
    """Where a picture meets itself it changes no more than inside."""
    pixels = texture(name).astype(float)
    for axis in (0, 1):
        steps = np.abs(np.diff(pixels, axis=axis)).mean(axis=(1 - axis, 2))
        seam = np.abs(np.take(pixels, 0, axis) - np.take(pixels, -1, axis)).mean()
        assert seam <= steps.max() * 1.3 + 2


def test_pixels_show_their_size() -> None:
    """A brick is 24 cm wide and 8 cm high: so far apart the mortar comes again."""
    up = np.arange(0, 0.96, 0.002)
    column = sample("wall_Brick_red", np.full_like(up, 0.06), up).astype(float).mean(axis=1)
    rows = [float(np.abs(column - np.roll(column, round(height / 0.002))).mean()) for height in (0.04, 0.08)]
    assert rows[1] < 0.6 * rows[0]


def test_finishes_can_be_told_apart() -> None:
    for surface, table in (("floor", FLOORS), ("wall", WALLS)):
        for material in table:
            names = [f"{surface}_{material}_{finish.name}" for finish in table[material].finishes]
            for one, other in itertools.combinations(names, 2):
                colors = np.abs(np.array(mean_color(one)) - mean_color(other)).max()
                assert colors > 0.03 or surface_finish(one).pattern != surface_finish(other).pattern, (one, other)


def test_another_process_makes_the_same_bytes() -> None:
    names = TEXTURED[::6]
    program = (
        "import hashlib; from prefect_robomaker.tasks.worldforge.materials.textures import texture_png\n"
        f"print(hashlib.sha256(b''.join(texture_png(name) for name in {names!r})).hexdigest())"
    )
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert printed.strip() == hashlib.sha256(b"".join(texture_png(name) for name in names)).hexdigest()


def test_plain_surfaces_have_one_colour() -> None:
    assert sample("wall_WallPaint_cream", np.zeros((2, 3)), np.zeros((2, 3))).shape == (2, 3, 3)
    assert mean_color("wall_WallPaint_cream") == pytest.approx(
        surface_finish("wall_WallPaint_cream").color[:3], abs=0.01
    )


def test_rubber_holds_differently_on_every_floor() -> None:
    order = ("Tiles", "Parquetry", "Floorboards", "Linoleum", "Concrete", "Carpet")
    frictions = [FLOORS[name].friction for name in order]
    assert frictions == sorted(set(frictions))


def test_an_unknown_finish_is_named_in_the_error() -> None:
    assert finish_named("floor", "Tiles", "").name == "white"
    with pytest.raises(ValueError, match=r"floor_finish 'pink' of Tiles: not known; one of white, terracotta"):
        finish_named("floor", "Tiles", "pink")
