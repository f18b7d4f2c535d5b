"""Maps of Nav2: the rooms of an empty flat come back, also from a map with noise."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from helpers.paths import REPOSITORY
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.schemas.wire.errors import ConfigurationError, RobomakerError
from prefect_robomaker.schemas.worlds.world import DrawnSource, Furniture, World
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import Source, import_world, planned
from prefect_robomaker.tasks.worldforge.geometry.occupancy import occupancy_grid, write_map
from prefect_robomaker.tasks.worldforge.proofs.guarantees import violations

FLAT = REPOSITORY / "deployments" / "specs" / "plans" / "flat.svg"


@pytest.fixture(scope="module")
def flat() -> World:
    return import_world(Source(FLAT), DrawingNotes(), 0, settle=False)


def imported(folder: Path, **notes: object) -> World:
    return import_world(Source(folder / "map.yaml"), DrawingNotes.model_validate(notes), 0, settle=False)


@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_rooms_and_doors_of_an_empty_flat_come_back(flat: World, noise: float, tmp_path: Path) -> None:
    write_map(occupancy_grid(flat.floorplan), tmp_path)
    picture = np.asarray(Image.open(tmp_path / "map.pgm")).copy()
    # A lidar sees walls a cell too thick here and there.
    beside = (picture == 254) & ((np.roll(picture, 1, 0) == 0) | (np.roll(picture, 1, 1) == 0))
    picture[beside & (np.random.default_rng(1).random(picture.shape) < noise)] = 0
    Image.fromarray(picture).save(tmp_path / "map.pgm")

    world = imported(tmp_path, rooms={"area-5": {"type": "Bathroom"}})
    rooms = world.floorplan.rooms
    mapped = {room.name: room.floor_m2 for room in flat.floorplan.rooms}
    # No door parts living room and kitchen: the map shows one room.
    expected = [mapped["Living room"] + mapped["Kitchen"], *sorted(list(mapped.values())[2:], reverse=True)]
    assert [room.floor_m2 for room in rooms] == pytest.approx(expected, rel=0.04 + 0.1 * noise)
    assert [room.type for room in rooms] == ["Living", "Bedroom", "Bedroom", "Hallway", "Bathroom"]
    assert sorted(passage.rooms for passage in world.floorplan.passages) == [
        ("area-1", "area-4"), ("area-1", "area-4"), ("area-2", "area-4"), ("area-3", "area-4"), ("area-4", "area-5"),
    ]  # fmt: skip
    assert all(passage.width_m == pytest.approx(0.9, abs=0.21) for passage in world.floorplan.passages)
    assert world.checks is not None
    assert violations(world.checks) == []
    assert isinstance(world.source, DrawnSource)
    assert (world.source.form, world.source.metres_per_unit) == ("nav2-map", 0.05)
    assert world.source.left_out[0].endswith("of the map's free cells, which are in no room")


def test_specks_are_no_walls_and_the_frame_of_the_map_is_told(flat: World, tmp_path: Path) -> None:
    write_map(occupancy_grid(flat.floorplan), tmp_path)
    clean = imported(tmp_path)
    picture = np.asarray(Image.open(tmp_path / "map.pgm")).copy()
    free = np.argwhere(picture == 254)
    for row, column in np.random.default_rng(2).choice(free, 60, replace=False):
        picture[row, column : column + 2] = 0
    Image.fromarray(picture).save(tmp_path / "map.pgm")
    text = (tmp_path / "map.yaml").read_text()
    said = re.search(r"origin: \[([-.0-9]+), ([-.0-9]+)", text)
    assert said is not None
    x, y = float(said[1]) + 10.0, float(said[2]) - 3.0
    (tmp_path / "map.yaml").write_text(text.replace(said[0], f"origin: [{x}, {y}"))

    world = imported(tmp_path)

    assert world.floorplan.rooms == clean.floorplan.rooms
    assert clean.source is not None
    assert clean.source.origin_m is not None
    assert isinstance(world.source, DrawnSource)
    assert world.source.origin_m == pytest.approx((clean.source.origin_m[0] + 10, clean.source.origin_m[1] - 3))
    # The map is the flat's own: what the import says of its frame puts walls back where they were.
    [bath] = [room for room in flat.floorplan.rooms if room.name == "Bathroom"]
    corners = [
        tuple(np.add(corner, clean.source.origin_m)) for room in clean.floorplan.rooms for corner in room.polygon
    ]
    for corner in bath.polygon:
        assert min(np.hypot(*np.subtract(corner, each)) for each in corners) < 0.1


def test_free_space_around_the_flat_is_named(flat: World, tmp_path: Path) -> None:
    write_map(occupancy_grid(flat.floorplan), tmp_path)
    picture = np.pad(np.asarray(Image.open(tmp_path / "map.pgm")), 40, constant_values=254)
    picture[picture == 205] = 254
    Image.fromarray(picture).save(tmp_path / "map.pgm")
    with pytest.raises(
        ConfigurationError, match=r"lies all around the rooms .* outside of the flat would have to be unknown"
    ):
        imported(tmp_path)


def as_a_robot_maps_it(picture: NDArray[np.uint8], seed: int, bump_cells: float) -> NDArray[np.uint8]:
    """Bumpy faces of walls, nothing known behind them, specks, cells that no ray hit, rays that left by a window."""
    rng = np.random.default_rng(seed)
    picture = np.pad(picture, 30, constant_values=205)
    free: NDArray[np.bool_] = np.equal(picture, 254)
    bumps = ndimage.gaussian_filter(rng.standard_normal(free.shape), 2.0)
    inside, outside = (np.asarray(ndimage.distance_transform_edt(each), float) for each in (free, ~free))
    seen: NDArray[np.bool_] = np.asarray(inside - outside > 0.7 + bump_cells * bumps / bumps.std(), bool)
    made: NDArray[np.uint8] = np.full(free.shape, 205, np.uint8)
    made[np.asarray(ndimage.binary_dilation(seen, iterations=2), bool)] = 0
    chance = rng.random(free.shape)
    made[seen] = np.where(chance < 0.12, 205, np.where(chance > 0.995, 0, 254))[seen]
    for _ in range(3):
        row, column = rng.integers(0, free.shape[0]), rng.integers(0, free.shape[1])
        beyond = np.arange(row, min(row + 60, len(made)))
        made[beyond, np.minimum(column + (beyond - row) // 2, made.shape[1] - 1)] = 254
    return made


def stored(picture: NDArray[np.uint8], folder: Path) -> Path:
    Image.fromarray(picture).save(folder / "map.pgm")
    said = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nfree_thresh: 0.196\noccupied_thresh: 0.65\nnegate: 0\n"
    (folder / "map.yaml").write_text(said)
    return folder / "map.yaml"


def mapped(world: World, folder: Path, furniture: Sequence[Furniture] = ()) -> NDArray[np.uint8]:
    write_map(occupancy_grid(world.floorplan, furniture), folder)
    return np.asarray(Image.open(folder / "map.pgm")).copy()


@pytest.mark.parametrize(
    "seed", [0, 1, pytest.param(2, marks=pytest.mark.deep), pytest.param(3, marks=pytest.mark.deep)]
)
@pytest.mark.parametrize("bump_cells", [0.8, 1.2])
def test_maps_of_real_robots_give_the_rooms_coarsely(flat: World, seed: int, bump_cells: float, tmp_path: Path) -> None:
    path = stored(as_a_robot_maps_it(mapped(flat, tmp_path), seed, bump_cells), tmp_path)
    made = planned(path, DrawingNotes(), 0)[2].floorplan
    drawn = sum(room.floor_m2 for room in flat.floorplan.rooms)
    assert sum(room.floor_m2 for room in made.rooms) == pytest.approx(drawn, rel=0.1)
    assert 3 <= len(made.rooms) <= 6
    assert len(made.passages) >= len(made.rooms) - 1
    assert all(passage.width_m >= 0.8 for passage in made.passages)


def test_a_map_with_some_furniture_gives_a_coarse_plan_and_says_so(flat: World, tmp_path: Path) -> None:
    path = stored(mapped(flat, tmp_path, flat.furniture[::4]), tmp_path)
    read, _, made, _ = planned(path, DrawingNotes(), 0)
    assert sum(room.floor_m2 for room in made.floorplan.rooms) > 0.6 * sum(
        room.floor_m2 for room in flat.floorplan.rooms
    )
    assert read.drawing.left_out[1].startswith("bumps of walls: outlines run along the lines")


@pytest.mark.parametrize(("degrees", "right"), [(8, "clockwise by "), (-20, "counter-clockwise by ")])
def test_a_map_that_leans_says_how_far_to_turn_it(flat: World, degrees: int, right: str, tmp_path: Path) -> None:
    picture = Image.fromarray(np.pad(mapped(flat, tmp_path), 30, constant_values=205))
    turned = np.asarray(picture.rotate(degrees, expand=True, fillcolor=205))
    with pytest.raises(
        ConfigurationError, match=rf"map\.yaml: the walls lean by .* turn its picture {right}"
    ) as refused:
        planned(stored(turned, tmp_path), DrawingNotes(), 0)
    said = re.search(r"turn its picture (\S+) by ([0-9.]+)", str(refused.value))
    assert said is not None
    back = float(said[2]) * (-1 if said[1] == "clockwise" else 1)
    assert back == pytest.approx(-degrees, abs=1)
    upright = np.asarray(Image.fromarray(turned).rotate(back, fillcolor=205))
    assert len(planned(stored(upright, tmp_path), DrawingNotes(), 0)[2].floorplan.rooms) >= 4


def test_a_map_of_very_many_rooms_is_refused_at_once(tmp_path: Path) -> None:
    picture = np.zeros((720, 720), np.uint8)
    for row in range(0, 720, 60):
        for column in range(0, 720, 60):
            picture[row + 3 : row + 57, column + 3 : column + 57] = 254
    with pytest.raises(ConfigurationError, match="its free space falls into 144 areas; at most 60 are right"):
        planned(stored(picture, tmp_path), DrawingNotes(), 0)


def test_areas_without_a_door_are_left_out(flat: World, tmp_path: Path) -> None:
    picture = np.pad(mapped(flat, tmp_path), ((0, 0), (0, 80)), constant_values=205)
    picture[20:80, -60:-10] = 254
    read, _, made, _ = planned(stored(picture, tmp_path), DrawingNotes(), 0)
    assert read.drawing.left_out[1:] == ["1 area that no door leads to"]
    assert [room.name for room in made.floorplan.rooms] == [f"area-{number}" for number in range(1, 6)]


def row_of_rooms(folder: Path, *widths: int, shut: int) -> Path:
    """Rooms of 80 rows side by side, with a door between each two but beside one of them."""
    picture, west, doors = np.zeros((84, 2 + sum(widths) + 2 * len(widths)), np.uint8), 2, range(len(widths) - 1)
    for number, width in enumerate(widths):
        picture[2:82, west : west + width] = 254
        west += width + 2
        if number in doors and shut not in (number, number + 1):
            picture[30:48, west - 2 : west] = 254
    return stored(picture, folder)


def test_a_map_of_which_no_door_leads_to_the_most_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"map\.yaml: no door leads from area-2.* to area-1 \(.*\) m: 50% of"):
        planned(row_of_rooms(tmp_path, 60, 60, 60, 180, shut=3), DrawingNotes(), 0)


def test_the_rooms_that_are_most_together_are_kept(tmp_path: Path) -> None:
    """The largest room of all has no door."""
    read, _, made, _ = planned(row_of_rooms(tmp_path, 70, 70, 70, 70, 70, 80, shut=5), DrawingNotes(), 0)
    assert read.drawing.left_out[1:] == ["1 area that no door leads to"]
    assert len(made.floorplan.rooms) == 5


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ("image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0.5]", "the map is turned by 0.5 rad; 0 would be right"),
        ("rooms: {}", "a map has image, resolution and origin"),
        ("image: gone.pgm\nresolution: 0.05\norigin: [0, 0, 0]", "gone.pgm: it cannot be read"),
        ("image: map.pgm\nresolution: 5\norigin: [0, 0, 0]", "resolution is 5; 0.005 to 0.25 m a cell"),
        ("image: map.pgm\nresolution: fine\norigin: [0, 0, 0]", "resolution, origin or a threshold is no number"),
        ("image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]", "no free space as large as a room"),
        ("image: [", "this is not YAML"),
    ],
)
def test_what_is_no_map_is_one_clear_error(wrong: str, expected: str, tmp_path: Path) -> None:
    Image.fromarray(np.full((50, 50), 205, np.uint8)).save(tmp_path / "map.pgm")
    (tmp_path / "map.yaml").write_text(wrong)
    with pytest.raises(RobomakerError) as refused:
        imported(tmp_path)
    assert expected in str(refused.value)
