"""Pictures from inside rooms: lit, from where one sees the room, the same every time."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.gazebo_house import write_house
from helpers.room_rules import template
from PIL import Image

from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.worlds.gazebo_notes import GazeboNotes
from prefect_robomaker.schemas.worlds.world import World, contains
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.pictures import room_lights
from prefect_robomaker.tasks.worldforge.pictures.ray_casting import Hits
from prefect_robomaker.tasks.worldforge.pictures.ray_light import LightGrid
from prefect_robomaker.tasks.worldforge.pictures.ray_picture import RayPicture
from prefect_robomaker.tasks.worldforge.pictures.room_lights import room_lighting
from prefect_robomaker.tasks.worldforge.pictures.room_looks import THRESHOLD_COLOR, Looks
from prefect_robomaker.tasks.worldforge.pictures.room_picture import best_camera, decorated_model, room_picture

WIDTH, HEIGHT = 120, 75
"""Size of the pictures in pixels: enough to tell things apart, in a quarter of the time of 240 x 150."""


def pixels(world: World, room: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(room_picture(world, room, WIDTH, HEIGHT)))).astype(float)


def test_a_room_has_a_picture_of_its_floor_and_furniture_with_light_and_shade(flat: World) -> None:
    room = flat.floorplan.rooms[0]
    full = pixels(flat, room.name)
    has_light_and_shade(full)
    empty = flat.model_copy(update={"furniture": []})
    bare = pixels(empty, room.name)
    assert (np.abs(full - bare).max(axis=2) > 25).mean() > 0.08
    # The same floor is darker where furniture stands on it than in the empty room: a lamp casts shadows.
    assert ((bare - full).min(axis=2) > 15).mean() > 0.02
    other = "Tiles" if room.floor_material != "Tiles" else "Carpet"
    changed = [
        each.model_copy(update={"floor_material": other, "floor_finish": ""}) if each.name == room.name else each
        for each in flat.floorplan.rooms
    ]
    retiled = empty.model_copy(update={"floorplan": flat.floorplan.model_copy(update={"rooms": changed})})
    low = np.abs(pixels(retiled, room.name) - bare)[HEIGHT * 2 // 3 :].max(axis=2)
    assert (low > 12).mean() > 0.4


@pytest.mark.deep
@pytest.mark.parametrize("room", ["Bath", "Kitchen", "Bedroom"])
def test_every_room_has_a_picture_with_light_and_shade(flat: World, room: str) -> None:
    has_light_and_shade(pixels(flat, room))


def has_light_and_shade(picture: np.ndarray) -> None:
    assert picture.shape == (HEIGHT, WIDTH, 3)
    brightness = picture.mean(axis=2)
    assert 70 < brightness.mean() < 215
    assert brightness.std() > 18
    # A camera right in front of a cupboard sees one colour.
    assert len(np.unique((picture // 16).reshape(-1, 3), axis=0)) > 60


@pytest.mark.deep
def test_the_same_world_gives_the_same_bytes(flat: World) -> None:
    name = flat.floorplan.rooms[0].name
    again = World.model_validate_json(flat.model_dump_json())
    assert room_picture(flat, name, 64, 40) == room_picture(again, name, 64, 40)


def test_an_unknown_room_is_named_in_the_error(flat: World) -> None:
    with pytest.raises(ValueError, match=r"room 'Cellar': .*; its rooms are Living Room, Kitchen"):
        room_picture(flat, "Cellar")


@pytest.fixture(scope="module")
def open_flat() -> World:
    """A flat whose kitchen is open to a much larger living room, from where one could see more of that."""
    rooms = (("Living", "Living", 30.0), ("Kitchen", "Kitchen", 12.0), ("Bedroom", "Bedroom", 14.0))
    body = template(rooms).model_dump(mode="json", exclude_none=True)
    plan = body["Buildings"][0]["Floors"][0]["Floorplan"]
    plan["DesiredConnections"] = [{"Location": ["Living", "Kitchen"], "ConnectionType": "Opening"}]
    return generate_world(parse_template_body(json.dumps(body)), 3, 4, settle=False)


def seen(world: World, room: str, width: int = 96, drop: float | None = None) -> tuple[list[str], LightGrid, Hits]:
    """Names of the geoms that a room's picture shows, its light without the shade of corners, and the places.

    A `drop` of the picture's middle other than the camera's shows more of the ceiling, or of the floor.
    """
    found = next(each for each in world.floorplan.rooms if each.name == room)
    model = decorated_model(world)
    looks = Looks(model, world)
    picture = RayPicture(model, looks.colors)
    camera = best_camera(picture, looks.names, world, found)
    camera = camera if drop is None else replace(camera, drop=drop)
    height = width * 5 // 8
    rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:height, 0:width])
    with picture.before(camera):
        hits = picture.hits(camera.place, camera.rays(width, height, columns, rows))
    lighting = replace(room_lighting(picture, looks, world, found), shaded_m=0.0)
    grid = LightGrid.cast(picture, hits, lighting, (height, width))
    return [looks.names[each] if each >= 0 else "" for each in hits.geoms], grid, hits


@pytest.mark.deep
def test_near_furniture_is_not_cut_by_the_edges_of_pictures() -> None:
    rooms = (("Living Room", "Living", 26.0), ("Kitchen", "Kitchen", 14.0), ("Bedroom", "Bedroom", 16.0))
    cut: list[float] = []
    for seed in range(4):
        world = generate_world(template(rooms), seed, seed, settle=False)
        for room in ("Kitchen", "Bedroom"):
            names, _, hits = seen(world, room, 48)
            own = {item.id for item in world.furniture if item.room == room}
            piece = np.array([name.partition(".")[0] in own for name in names]).reshape(30, 48)
            low = hits.places[:, 2].reshape(30, 48)
            lower = piece[-1] & (low[-1] > 0.3)  # a top or a seat at the picture's lower edge is near
            cut.append(float(lower.mean()))
    assert np.mean(cut) < 0.33  # 0.38 where cameras do not mind


def test_plinths_are_not_black(flat: World) -> None:
    model = decorated_model(flat)
    looks = Looks(model, flat)
    plinths = [number for number, name in enumerate(looks.names) if name.partition(".")[2].startswith("plinth")]
    assert plinths
    nothing = np.zeros((len(plinths), 3))
    colors = looks.colors(Hits(np.array(plinths, np.int32), nothing, nothing + np.array((1.0, 0.0, 0.0))))
    assert colors.min() > 0.25


def test_a_kitchen_that_is_open_to_a_larger_room_is_itself_in_its_picture(open_flat: World) -> None:
    names, _, hits = seen(open_flat, "Kitchen")
    kitchen = next(each for each in open_flat.floorplan.rooms if each.name == "Kitchen")
    (west, south), (east, north) = np.min(kitchen.polygon, axis=0), np.max(kitchen.polygon, axis=0)
    x, y, _ = hits.places.T
    inside = (x >= west) & (x <= east) & (y >= south) & (y <= north) & (hits.geoms >= 0)
    assert inside.mean() > 0.6
    kinds = {item.id: item.model_type for item in open_flat.furniture if item.room == "Kitchen"}
    assert {"Ovens", "Storage"} <= {kinds.get(name.partition(".")[0]) for name in names}


def test_nothing_stands_before_the_camera(open_flat: World) -> None:
    room = next(each for each in open_flat.floorplan.rooms if each.name == "Bedroom")
    model = decorated_model(open_flat)
    looks = Looks(model, open_flat)
    picture = RayPicture(model, looks.colors)
    camera = best_camera(picture, looks.names, open_flat, room)
    rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:30, 0:48])
    with picture.before(camera):
        hits = picture.hits(camera.place, camera.rays(48, 30, columns, rows))
    # Also from behind a wall one sees this room, and no wall.
    inside = [contains(room.polygon, x, y) for x, y, _ in hits.places + 0.15 * hits.normals]
    assert np.mean(inside) > 0.75
    away = np.linalg.norm(hits.places - np.array(camera.place), axis=1)
    assert (away[hits.geoms >= 0] < 1.0).mean() < 0.03
    names = [looks.names[each] for each in hits.geoms if each >= 0]
    assert np.mean([each.startswith("door-") for each in names]) < 0.15


def test_what_a_room_is_decorated_with_is_in_its_picture(open_flat: World) -> None:
    names = [name for room in open_flat.floorplan.rooms for name in seen(open_flat, room.name, 48)[0]]
    decoration = {name.partition("_")[0] for name in names}
    assert {"thing", "window", "skirting"} <= decoration
    assert decoration & {"curtain", "blind"}
    assert decoration & {"rug", "picture"}
    assert "" in names  # one looks out of windows


def test_the_ceiling_has_no_border_between_light_and_dark(open_flat: World) -> None:
    _, grid, _ = seen(open_flat, "Living", 480, drop=-0.25)
    height_m = open_flat.floorplan.ceiling_height_m
    ceiling = ((np.abs(grid.hits.places[:, 2] - height_m) < 0.01) & (grid.hits.normals[:, 2] < -0.9)).reshape(
        grid.shape
    )
    bright = grid.light.mean(axis=1).reshape(grid.shape)
    assert ceiling.sum() > 200
    one, other = bright[:, 1:], bright[:, :-1]
    beside = ceiling[:, 1:] & ceiling[:, :-1]
    assert (np.abs(one - other)[beside] / one[beside]).max() < 0.18


def test_a_threshold_covers_the_joint_of_two_floors_and_one_floor_goes_on(open_flat: World) -> None:
    passage = next(each for each in open_flat.floorplan.passages if each.kind == "Opening")
    x, y = (passage.start[0] + passage.end[0]) / 2, (passage.start[1] + passage.end[1]) / 2
    for finishes, is_covered in ((("sand", "moss"), True), (("sand", "sand"), False)):
        finish_of = dict(zip(passage.rooms, finishes, strict=True))
        rooms = [
            each.model_copy(update={"floor_material": "Carpet", "floor_finish": finish_of.get(each.name, "sand")})
            for each in open_flat.floorplan.rooms
        ]
        world = open_flat.model_copy(
            update={"floorplan": open_flat.floorplan.model_copy(update={"rooms": rooms}), "furniture": []}
        )
        model = decorated_model(world)
        looks = Looks(model, world)
        hits = RayPicture(model, looks.colors).hits((x, y, 1.0), np.array([[0.0, 0.0, -1.0]]))
        assert np.allclose(looks.colors(hits)[0], THRESHOLD_COLOR) == is_covered


def test_rooms_of_worlds_from_gazebo_have_pictures_without_decoration(tmp_path: Path) -> None:
    notes = GazeboNotes.model_validate(
        {"rooms": {"East": {"polygon": [[2.1, -2.6], [6.1, -2.6], [6.1, 2.6], [2.1, 2.6]]}}}
    )
    wishes = Wishes(start=Start(0.0, 0.0), notes=notes)
    import_gazebo_world(write_house(tmp_path / "house"), wishes, tmp_path / "bundle")
    world = read_world(tmp_path / "bundle")
    picture = pixels(world, "East")
    assert picture.std() > 5
    assert not any(name.startswith(("thing_", "picture_", "rug_")) for name in seen(world, "East")[0])


@pytest.fixture(scope="module")
def flat_model(flat: World) -> Any:
    """The flat, compiled once for tests that draw nothing."""
    return decorated_model(flat)


def test_a_wall_has_the_finish_of_the_room_that_sees_it_also_at_the_end_of_another_wall(
    flat: World, flat_model: Any
) -> None:
    looks = Looks(flat_model, flat)
    walls = [number for number, name in enumerate(looks.names) if name.startswith("wall_")]

    def colors(x: float, y: float) -> np.ndarray:
        places, normals = np.tile((x, y, 1.0), (len(walls), 1)), np.tile((1.0, 0.0, 0.0), (len(walls), 1))
        return looks.colors(Hits(np.array(walls, np.int32), places, normals))

    inside = [colors(*room.goal) for room in flat.floorplan.rooms]
    assert all(np.ptp(each, axis=0).max() == 0 for each in inside)
    assert len({each[0].tobytes() for each in inside}) > 1
    # Outside the building, walls have finishes of their own.
    assert np.ptp(colors(-50.0, -50.0), axis=0).max() > 0.05


def test_a_standing_lamp_shines_past_its_shade_and_the_garden_begins_behind_the_walls(
    flat: World, flat_model: Any
) -> None:
    looks = Looks(flat_model, flat)
    caster = RayPicture(flat_model, looks.colors)
    middle, _ = looks.lit_shades()[0]
    room = next(each for each in flat.floorplan.rooms if contains(each.polygon, *middle[:2]))
    near = [
        lamp
        for group in room_lighting(caster, looks, flat, room).lamps
        for lamp in group
        if lamp.color == room_lights._STANDING_COLOR and np.linalg.norm(np.subtract(lamp.place, middle)) < 0.5
    ]
    assert len(near) >= 4
    for lamp in near:
        hit = caster.hits(lamp.place, np.array([lamp.facing or ()]))
        assert np.linalg.norm(hit.places[0] - lamp.place) > 0.3 or not looks.names[hit.geoms[0]].endswith("shade")
    places = np.array([(*flat.floorplan.rooms[0].goal, 1.0), (-50.0, 0.0, 1.0)])
    hits = Hits(np.zeros(2, np.int32), places, np.tile((0.0, 0.0, 1.0), (2, 1)))
    assert looks.outdoors(hits).tolist() == [False, True]
