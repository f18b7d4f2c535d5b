"""Maps of Nav2: the rooms of an empty flat come back, also from a map with noise."""

import re
from pathlib import Path

import numpy as np
import pytest
from helpers.paths import REPOSITORY
from PIL import Image

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.schemas.wire.errors import ConfigurationError, RobomakerError
from prefect_robomaker.schemas.worlds.world import DrawnSource, World
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import Source, import_world
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
    with pytest.raises(ConfigurationError, match="what is outside of the flat would have to be unknown"):
        imported(tmp_path)


def test_a_map_of_furniture_is_refused(flat: World, tmp_path: Path) -> None:
    write_map(occupancy_grid(flat.floorplan, flat.furniture), tmp_path)
    with pytest.raises(ConfigurationError, match=r"map\.yaml: .*"):
        imported(tmp_path)


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ("image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0.5]", "the map is turned by 0.5 rad; 0 would be right"),
        ("rooms: {}", "a map has image, resolution and origin"),
        ("image: gone.pgm\nresolution: 0.05\norigin: [0, 0, 0]", "gone.pgm: it cannot be read"),
        ("image: map.pgm\nresolution: 5\norigin: [0, 0, 0]", "resolution is 5; 0.005 to 0.25 m a cell"),
        ("image: map.pgm\nresolution: fine\norigin: [0, 0, 0]", "resolution, origin or free_thresh is no number"),
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
