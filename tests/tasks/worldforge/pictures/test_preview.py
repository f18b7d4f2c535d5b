"""Previews: pictures that show the world, the same ones every time."""

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image

from prefect_robomaker.schemas.worlds.world import FLOOR_MATERIALS, World
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.pictures.preview import HEIGHT, WIDTH, render_preview
from prefect_robomaker.tasks.worldforge.pictures.preview_raster import Raster, View

from ..conftest import MakeBody

VIEW = View(azimuth_deg=0.0, elevation_deg=60.0, scale=50.0, offset=(100.0, 100.0), size=(200, 200))


def pixels(world: World) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(render_preview(world)))).astype(float)


def test_the_same_world_gives_the_same_bytes(flat: World) -> None:
    picture = render_preview(flat)
    assert picture == render_preview(World.model_validate_json(flat.model_dump_json()))
    assert Image.open(io.BytesIO(picture)).size == (WIDTH, HEIGHT)


def test_furniture_shows(flat: World) -> None:
    full, empty = pixels(flat), pixels(flat.model_copy(update={"furniture": []}))
    changed = np.abs(full - empty).max(axis=2) > 20
    assert 0.05 < changed.mean() < 0.5
    for item in flat.furniture:
        without = [other for other in flat.furniture if other.id != item.id]
        if item.height_m > 0.3 and not item.movable:
            lone = pixels(flat.model_copy(update={"furniture": without}))
            assert (np.abs(full - lone).max(axis=2) > 20).sum() > 60, item.id
            break


def test_the_building_fills_the_picture_and_is_not_cut_off(flat: World) -> None:
    picture = pixels(flat)
    background = picture[2, 2]
    seen = np.abs(picture - background).max(axis=2) > 30
    rows, columns = np.nonzero(seen)
    assert rows.min() > 5
    assert columns.min() > 5
    assert rows.max() < HEIGHT - 5
    assert columns.max() < WIDTH - 5
    assert (rows.max() - rows.min()) / HEIGHT > 0.75 or (columns.max() - columns.min()) / WIDTH > 0.75


def test_floor_materials_can_be_told_apart(make_body: MakeBody) -> None:
    def floor(material: str) -> np.ndarray:
        wish: list[dict[str, Any]] = [
            {
                "Name": "all",
                "TargetSet": {"RoomTypes": ["Living"]},
                "SampleSet": {"MaterialTypes": [material]},
            }
        ]
        body = make_body((("Lounge", "Living", 30.0),), flooring=wish)
        world = generate_world(body, 1, 1, settle=False).model_copy(update={"furniture": []})
        return pixels(world)[300:420, 400:560].reshape(-1, 3)

    looks = {}
    for material in FLOOR_MATERIALS:
        sample = floor(material)
        looks[material] = np.concatenate([sample.mean(axis=0), 2 * sample.std(axis=0)])
    for one in looks:
        for other in looks:
            if one != other:
                assert np.abs(looks[one] - looks[other]).max() > 9, (one, other)


def test_nearer_faces_hide_farther_ones_in_whatever_order() -> None:
    def drawn(order: tuple[int, ...]) -> np.ndarray:
        raster = Raster(VIEW)
        for color in order:
            height = 0.1 * color
            raster.parallelogram((-0.5, -0.5, height), (1, 0, 0), (0, 1, 0), color)
        return raster.ids

    assert np.array_equal(drawn((1, 2, 3)), drawn((3, 1, 2)))
    assert (drawn((1, 2, 3)) == 3).sum() == pytest.approx(50 * 50 * 0.866, rel=0.03)


def test_large_faces_are_drawn_whole() -> None:
    view = View(azimuth_deg=-30.0, elevation_deg=50.0, scale=100.0, offset=(400.0, 400.0), size=(800, 800))
    raster = Raster(view)
    raster.parallelogram((-2.0, -1.5, 0.0), (4, 0, 0), (0, 3, 0), 1)
    assert (raster.ids == 1).sum() == pytest.approx(4 * 3 * 100 * 100 * 0.766, rel=0.01)


def test_round_things_are_round() -> None:
    raster = Raster(VIEW)
    raster.ball((0.0, 0.0, 0.5), (0.5, 0.5, 0.5), 1)
    assert (raster.ids > 0).sum() == pytest.approx(np.pi * 25**2, rel=0.03)
    assert len(np.unique(raster.ids)) > 6
    raster = Raster(VIEW)
    raster.disc((0.0, 0.0, 0.0), (0.5, 0, 0), (0, 0.5, 0), 1)
    assert (raster.ids > 0).sum() == pytest.approx(np.pi * 25**2 * 0.866, rel=0.03)
    raster = Raster(VIEW)
    raster.post((0.0, 0.0, 0.0), 0.5, 1.0, 1)
    assert (raster.ids > 0).sum() == pytest.approx(50 * 50 * 0.5, rel=0.05)
