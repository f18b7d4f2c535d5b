"""Pictures from inside rooms: lit, from where one sees the room, the same every time."""

import io

import numpy as np
import pytest
from PIL import Image

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.pictures.room_picture import room_picture


def pixels(world: World, room: str, size: tuple[int, int] = (240, 150)) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(room_picture(world, room, *size)))).astype(float)


def test_every_room_has_a_picture_with_light_and_shade(flat: World) -> None:
    for room in flat.floorplan.rooms:
        picture = pixels(flat, room.name)
        assert picture.shape == (150, 240, 3)
        brightness = picture.mean(axis=2)
        assert 70 < brightness.mean() < 215, room.name
        assert brightness.std() > 18, room.name
        # A camera right in front of a cupboard sees one colour.
        assert len(np.unique((picture // 16).reshape(-1, 3), axis=0)) > 60, room.name


def test_the_same_world_gives_the_same_bytes(flat: World) -> None:
    name = flat.floorplan.rooms[0].name
    again = World.model_validate_json(flat.model_dump_json())
    assert room_picture(flat, name, 160, 100) == room_picture(again, name, 160, 100)


def test_furniture_and_floor_show(flat: World) -> None:
    room = flat.floorplan.rooms[0]
    full = pixels(flat, room.name)
    empty = flat.model_copy(update={"furniture": []})
    assert (np.abs(full - pixels(empty, room.name)).max(axis=2) > 25).mean() > 0.08
    other = "Tiles" if room.floor_material != "Tiles" else "Carpet"
    changed = [
        each.model_copy(update={"floor_material": other, "floor_finish": ""}) if each.name == room.name else each
        for each in flat.floorplan.rooms
    ]
    retiled = empty.model_copy(update={"floorplan": flat.floorplan.model_copy(update={"rooms": changed})})
    low = np.abs(pixels(retiled, room.name) - pixels(empty, room.name))[100:].max(axis=2)
    assert (low > 12).mean() > 0.4


def test_a_lamp_casts_shadows_under_the_furniture(flat: World) -> None:
    """The same floor is darker where furniture stands on it than in the empty room."""
    empty = flat.model_copy(update={"furniture": []})
    name = next(room.name for room in flat.floorplan.rooms if room.type == "Living")
    full, bare = pixels(flat, name), pixels(empty, name)
    darker = (bare - full).min(axis=2)
    assert (darker > 15).mean() > 0.02


def test_an_unknown_room_is_named_in_the_error(flat: World) -> None:
    with pytest.raises(ValueError, match=r"room 'Cellar': .* one of Living Room, Kitchen"):
        room_picture(flat, "Cellar")
