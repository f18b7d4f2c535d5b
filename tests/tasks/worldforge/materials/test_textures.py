"""Textures: seamless, small, the same on every machine, and different from each other."""

import io
import itertools
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest
from helpers.paths import REPOSITORY
from PIL import Image

from prefect_robomaker.schemas.worlds.world import FLOOR_MATERIALS, WALL_MATERIALS
from prefect_robomaker.tasks.worldforge.materials import texture_files
from prefect_robomaker.tasks.worldforge.materials.materials import FLOORS, WALLS, finish_named, surface_finish
from prefect_robomaker.tasks.worldforge.materials.texture_files import FOLDER, texture_png, textured, write_textures
from prefect_robomaker.tasks.worldforge.materials.textures import (
    SKY,
    mean_color,
    painted_png,
    sample,
    texture,
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


@pytest.mark.parametrize("name", [SKY, *TEXTURED])
def test_what_comes_with_the_package_is_what_would_be_painted(name: str) -> None:
    """The pixels are; how they are packed depends on the library, and the package's bytes do not."""
    assert _pixels(texture_png(name)).tobytes() == _pixels(painted_png(name)).tobytes()


def _pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def test_every_texture_comes_with_the_package_and_nothing_else() -> None:
    assert textured() == [SKY, *TEXTURED]
    files = {path.name for path in FOLDER.iterdir()}
    assert files == {f"{name}.png" for name in textured()}
    data = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    patterns = data["prefect_robomaker.tasks.worldforge.materials"]
    assert all(any(fnmatch(f"{FOLDER.name}/{name}", pattern) for pattern in patterns) for name in files)


def test_textures_of_finishes_that_are_gone_go_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "floor_Tiles_pink.png").write_bytes(b"")
    monkeypatch.setattr(texture_files, "textured", lambda: [SKY])
    write_textures(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["sky.png"]


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
