"""A world's pictures as files."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.viewer.pictures import write_pictures


@pytest.mark.deep
def test_plan_preview_and_every_room_are_drawn(flat: World, tmp_path: Path) -> None:
    bundle, folder = tmp_path / "bundle", tmp_path / "new" / "pictures"
    bundle.mkdir()
    files = write_pictures(flat, bundle, folder)
    names = [path.name for path in files]
    assert names[:3] == ["floorplan.svg", "preview.png", "room-1-Living_Room.png"]
    assert len(names) == 2 + len(flat.floorplan.rooms)
    assert ElementTree.parse(files[0]).getroot().tag.endswith("svg")
    for path in files[1:]:
        with Image.open(path) as picture:
            assert picture.width == 960


@pytest.mark.deep
def test_the_bundles_own_preview_is_taken(flat: World, tmp_path: Path) -> None:
    (tmp_path / "preview.png").write_bytes(b"as it was stored")
    files = write_pictures(flat, tmp_path, tmp_path / "pictures")
    assert files[1].read_bytes() == b"as it was stored"
