"""Previews: pictures that show the world, the same ones every time."""

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from prefect_robomaker.schemas.worlds.world import FLOOR_MATERIALS, World
from prefect_robomaker.tasks.worldforge.decor.faces import walls_of_windows, window_heights
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.pictures import preview
from prefect_robomaker.tasks.worldforge.pictures.preview import HEIGHT, WIDTH, render_preview
from prefect_robomaker.tasks.worldforge.pictures.preview_labels import readable, with_labels
from prefect_robomaker.tasks.worldforge.pictures.preview_raster import CUT, Block, LightMap, Palette, Raster, View
from prefect_robomaker.tasks.worldforge.pictures.preview_things import things_from_above

from ..conftest import MakeBody

VIEW = View(azimuth_deg=0.0, elevation_deg=60.0, scale=50.0, offset=(100.0, 100.0), size=(200, 200))


def pixels(world: World) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(render_preview(world)))).astype(float)


def test_a_preview_shows_the_whole_building_and_its_furniture_and_is_the_same_every_time(flat: World) -> None:
    content = render_preview(flat)
    assert content == render_preview(World.model_validate_json(flat.model_dump_json()))
    picture = Image.open(io.BytesIO(content))
    assert picture.size == (WIDTH, HEIGHT)
    full = np.asarray(picture).astype(float)
    fills_the_picture_and_is_not_cut_off(full)

    changed = np.abs(full - pixels(flat.model_copy(update={"furniture": []}))).max(axis=2) > 20
    assert 0.05 < changed.mean() < 0.5
    item = next(item for item in flat.furniture if item.height_m > 0.3 and not item.movable)
    without = [other for other in flat.furniture if other.id != item.id]
    lone = pixels(flat.model_copy(update={"furniture": without}))
    assert (np.abs(full - lone).max(axis=2) > 20).sum() > 60, item.id


def fills_the_picture_and_is_not_cut_off(picture: np.ndarray) -> None:
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


def test_steep_and_level_edges_have_five_shades() -> None:
    """Each pixel has four parts, none of which is in line with another one."""
    for turned in (False, True):
        raster = Raster(View(azimuth_deg=0.0, elevation_deg=90.0, scale=1.0, offset=(0.0, 200.0), size=(200, 200)))
        along, across = ((100.0, 6.0, 0.0), (0.0, 60.0, 0.0)) if turned else ((6.0, 100.0, 0.0), (60.0, 0.0, 0.0))
        raster.parallelogram((20.0, 20.0, 0.0), along, across, 1)
        share = raster.ids.reshape(100, 2, 100, 2).mean(axis=(1, 3))
        middle = share[:, 15:55] if turned else share[45:85]
        mixed = middle[(middle > 0) & (middle < 1)]
        assert np.mean(mixed != 0.5) > 0.3


def test_shadows_have_soft_edges_without_steps() -> None:
    light = LightMap.of([Block(1.0, 1.0, 1.2, 3.0, 1.0)], (0.0, 0.0, 4.0, 4.0))
    x, y = (axis.astype(np.float32) for axis in np.meshgrid(np.arange(1.3, 3.0, 0.01), np.arange(1.6, 2.2, 0.01)))
    bright = light.brightness(x, y, np.zeros_like(x), np.ones_like(x))
    assert bright.max() - bright.min() > 0.3
    assert np.abs(np.diff(bright, axis=1)).max() < 0.08
    # The wall runs north, so that its shadow's edge does: nothing changes along it.
    assert np.abs(np.diff(bright, axis=0)).max() < 0.01


def test_the_floor_before_a_wall_on_its_lit_side_is_dark_at_the_wall_alone() -> None:
    light = LightMap.of([Block(1.0, 1.0, 1.2, 3.0, 1.2)], (0.0, 0.0, 4.0, 4.0))
    x = np.linspace(0.0, 0.98, 99, dtype=np.float32)
    bright = light.brightness(x, np.full_like(x, 2.0), np.zeros_like(x), np.ones_like(x))
    assert bright[-1] < 0.75
    assert bright[x < 0.55].min() > 0.99
    assert bright[x < 0.85].min() > 0.93


def test_a_turned_block_darkens_the_floor_below_it() -> None:
    light = LightMap.of([Block(1.0, 1.9, 3.0, 2.1, 0.5, np.pi / 2)], (0.0, 0.0, 4.0, 4.0))
    x, y = np.array((2.0, 2.0, 1.1), np.float32), np.array((1.2, 2.8, 2.0), np.float32)
    south, north, west = light.brightness(x, y, np.zeros_like(x), np.ones_like(x))
    assert max(south, north) < 0.75
    assert west > 0.98


def test_cut_walls_have_a_thin_outline_all_round() -> None:
    raster = Raster(VIEW)
    raster.parallelogram((-1.5, -1.5, 0.0), (3, 0, 0), (0, 3, 0), 2)
    raster.parallelogram((-0.5, -0.5, 0.0), (1, 0, 0), (0, 1, 0.001), CUT)
    lit = np.full((100, 100, 3), 200, np.uint8)
    preview._draw_outlines(raster, lit)
    dark: Any = ndimage.label(lit[25:75, 25:75, 0] < 190)  # not the outer face's own outline
    ring, count = dark
    assert count == 1
    assert 0.03 < (ring > 0).mean() < 0.12
    assert lit[50, 50, 0] == 200


def test_a_wall_is_cut_to_the_sills_of_its_windows_and_a_low_one_bears_their_signs(flat: World) -> None:
    plan, sill = flat.floorplan, window_heights(flat)[0]
    tops = {True: set[float](), False: set[float]()}
    for wall in walls_of_windows(flat).values():
        raster = Raster(VIEW)
        is_low = preview._top_m(wall, flat) < sill
        tops[is_low] |= {block.height for block in preview._draw_wall(wall, flat, raster, Palette())}
    assert tops == {True: {preview._NEAR_CUT_M}, False: {preview._CUT_M, sill}}
    blue = pixels(flat)
    windowless = pixels(flat.model_copy(update={"floorplan": plan.model_copy(update={"windows": []})}))
    changed: Any = ndimage.label(ndimage.binary_dilation(np.abs(blue - windowless).max(axis=2) > 12, iterations=2))
    assert changed[1] >= len(plan.windows)


def test_a_label_covers_no_furniture_and_is_smaller_where_little_floor_is_free(flat: World) -> None:
    room, gray = flat.floorplan.rooms[0], np.full((200, 300, 3), 90, np.uint8)
    heights = []
    for free in (slice(20, 180), slice(90, 116)):
        floors = np.full((200, 300), 2, np.int32)  # furniture
        floors[free, 160:290] = 1
        paper = np.any(with_labels(gray, floors, {1: room}) != gray, axis=2)
        assert paper.any()
        assert not paper[floors == 2].any()
        heights.append(np.flatnonzero(paper.any(axis=1)).size)
    assert heights[1] < 26 < heights[0]


def test_rugs_and_small_things_are_seen_from_above(flat: World, monkeypatch: pytest.MonkeyPatch) -> None:
    names = {solid.name for solid in things_from_above(flat)}
    assert any(name.startswith("rug_") for name in names)
    carriers = {item.id for item in flat.furniture}
    assert {name.split("_", 1)[1].rsplit("_", 2)[0] for name in names if name.startswith("thing_")} & carriers
    with_things = pixels(flat)
    monkeypatch.setattr(preview, "things_from_above", lambda _: [])
    changed = np.abs(with_things - pixels(flat)).max(axis=2) > 12
    assert 0.001 < changed.mean() < 0.2


def test_a_strip_lies_between_two_floors(flat: World, monkeypatch: pytest.MonkeyPatch) -> None:
    with_strips = pixels(flat)
    monkeypatch.setattr(preview, "has_joint", lambda *_: False)
    changed = np.abs(with_strips - pixels(flat)).max(axis=2) > 12
    assert 0.00005 < changed.mean() < 0.02


def test_each_room_has_its_name_on_its_own_floor(flat: World, monkeypatch: pytest.MonkeyPatch) -> None:
    bare = flat.model_copy(update={"furniture": []})
    labelled = pixels(bare)
    monkeypatch.setattr(preview, "with_labels", lambda lit, *_: lit)
    unlabelled = pixels(bare)
    paper = np.abs(labelled - unlabelled).max(axis=2) > 3
    labels: Any = ndimage.label(ndimage.binary_closing(paper, iterations=2))
    found, count = labels
    assert count == len(flat.floorplan.rooms)
    for place in ndimage.find_objects(found):
        # Letters are dark on paper, and the label lies on one floor: below it there is no white top of a wall.
        assert labelled[place].min() < 80 < 200 < np.median(labelled[place])
        assert (unlabelled[place].min(axis=2) > 243).mean() < 0.1


def test_names_of_rooms_are_written_in_the_letters_that_the_font_has(flat: World) -> None:
    room = flat.floorplan.rooms[0]
    shown = {name: readable(room.model_copy(update={"original_name": name})) for name in ("Salon 2", "Küche", "台所")}
    assert shown == {"Salon 2": "Salon 2", "Küche": room.name, "台所": room.name}


def test_tall_furniture_is_cut_and_a_floor_lamp_is_whole(flat: World) -> None:
    tall = max(flat.furniture, key=lambda item: item.height_m)
    assert tall.height_m > 1.6
    cut = preview._cut_solids(tall)
    assert max(solid.center[2] + solid.size[2] / 2 for solid in cut) == pytest.approx(1.3)
    assert min(solid.size[2] for solid in cut) > 0
    lamp = tall.model_copy(update={"model_type": "FloorLamps", "style": "shade black"})
    assert max(solid.center[2] + solid.size[2] / 2 for solid in preview._cut_solids(lamp)) > 1.5
