"""A world's pictures as files."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.viewer import viewer_page
from prefect_robomaker.tasks.worldforge.viewer.viewer_page import write_pictures

from ..conftest import MakeBody


@pytest.mark.deep
def test_plan_preview_and_a_room_are_drawn(make_body: MakeBody, tmp_path: Path) -> None:
    world = generate_world(make_body((("A closet", "Closet", 10.0),)), 1, 2, settle=False)
    files = write_pictures(world, tmp_path, tmp_path / "pictures")
    assert [path.name for path in files] == ["floorplan.svg", "preview.png", "room-1-A_closet.png"]
    for path in files[1:]:
        with Image.open(path) as picture:
            assert picture.width == 960


def test_the_bundles_own_preview_is_taken_and_each_room_has_a_file(
    flat: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def drawn(world: World, room: str) -> bytes:
        assert world is flat
        return room.encode()

    monkeypatch.setattr(viewer_page, "room_picture", drawn)  # what it draws is told by its own tests
    (tmp_path / "preview.png").write_bytes(b"as it was stored")
    told: list[str] = []
    files = write_pictures(flat, tmp_path, tmp_path / "new" / "pictures", told.append)
    assert told == [f"picture {number} of 6: {path.name}" for number, path in enumerate(files, 1)]
    assert files[1].read_bytes() == b"as it was stored"
    assert [path.name for path in files[:3]] == ["floorplan.svg", "preview.png", "room-1-Living_Room.png"]
    assert ElementTree.parse(files[0]).getroot().tag.endswith("svg")
    assert [path.read_text() for path in files[2:]] == [room.name for room in flat.floorplan.rooms]
