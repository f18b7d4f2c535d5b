"""Pictures from inside rooms: lit, from where one sees the room, the same every time."""

import io

import numpy as np
import pytest
from PIL import Image

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.pictures.room_picture import room_picture


def pixels(world: World, room: str, size: tuple[int, int] = (240, 150)) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(room_picture(world, room, *size)))).astype(float)


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
    low = np.abs(pixels(retiled, room.name) - bare)[100:].max(axis=2)
    assert (low > 12).mean() > 0.4


@pytest.mark.parametrize(
    "room", ["Bath", *(pytest.param(room, marks=pytest.mark.deep) for room in ("Kitchen", "Bedroom"))]
)
def test_every_room_has_a_picture_with_light_and_shade(flat: World, room: str) -> None:
    has_light_and_shade(pixels(flat, room))


def has_light_and_shade(picture: np.ndarray) -> None:
    assert picture.shape == (150, 240, 3)
    brightness = picture.mean(axis=2)
    assert 70 < brightness.mean() < 215
    assert brightness.std() > 18
    # A camera right in front of a cupboard sees one colour.
    assert len(np.unique((picture // 16).reshape(-1, 3), axis=0)) > 60


def test_the_same_world_gives_the_same_bytes(flat: World) -> None:
    name = flat.floorplan.rooms[0].name
    again = World.model_validate_json(flat.model_dump_json())
    assert room_picture(flat, name, 160, 100) == room_picture(again, name, 160, 100)


def test_an_unknown_room_is_named_in_the_error(flat: World) -> None:
    with pytest.raises(ValueError, match=r"room 'Cellar': .* one of Living Room, Kitchen"):
        room_picture(flat, "Cellar")
