"""Worlds in Gazebo's format become worlds like ours, with a map, proofs and a list of what was left out."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import os
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.gazebo_house import WALLS, write_house
from PIL import Image

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.schemas.worlds.gazebo_notes import GazeboNotes
from prefect_robomaker.schemas.worlds.world import GazeboSource, World
from prefect_robomaker.tasks.runtime.episode.occupancy_map import OccupancyMap, read_map
from prefect_robomaker.tasks.worldforge.bundle.bundle import content_hash, read_world
from prefect_robomaker.tasks.worldforge.bundle.proving import prove
from prefect_robomaker.tasks.worldforge.exports.export import write_export_zip
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world
from prefect_robomaker.tasks.worldforge.proofs.guarantees import violations
from prefect_robomaker.tasks.worldforge.viewer.viewer_page import viewer_page, write_pictures
from prefect_robomaker.tasks.worlds.gazebo_imports import GazeboImport, write_gazebo_bundle

NOTES = GazeboNotes.model_validate({
    "rooms": {
        "West": {"type": "Living", "polygon": [[-2.1, -2.6], [2.1, -2.6], [2.1, 2.6], [-2.1, 2.6]]},
        "East": {"polygon": [[2.1, -2.6], [6.1, -2.6], [6.1, 2.6], [2.1, 2.6]]},
    },
    "goals": {"window": [5.2, 0.2]},
})  # fmt: skip


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bundle of the house, imported with rooms and a goal from (0, 0)."""
    folder = tmp_path_factory.mktemp("gazebo")
    path = write_house(folder / "house")
    import_gazebo_world(path, Wishes(start=Start(0.0, 0.0), notes=NOTES), folder / "bundle")
    return folder / "bundle"


@pytest.fixture(scope="module")
def world(house: Path) -> World:
    return read_world(house)


def source_of(world: World) -> GazeboSource:
    assert isinstance(world.source, GazeboSource)
    return world.source


def test_it_is_proved_and_says_where_it_is_from(world: World) -> None:
    assert world.checks is not None
    assert violations(world.checks) == []
    assert source_of(world).origin_m == (0.0, 0.0, 0.03)
    assert source_of(world).goals == {"window": (5.2, 0.2)}
    assert [(room.name, room.type) for room in world.floorplan.rooms] == [("West", "Living"), ("East", "Area")]
    assert [room.floor_m2 for room in world.floorplan.rooms] == pytest.approx([19.4, 18.8], abs=0.5)
    assert world.checks.reachable_m2 == pytest.approx(28, abs=2)
    loose = {item.id for item in world.furniture if item.movable}
    assert loose == {"crate"}
    assert {"shelf", "lamp", "furnishing_table", "furnishing_table_2"} <= {item.id for item in world.furniture} - loose


def test_every_omission_is_listed(world: World) -> None:
    listed = {(left.what, left.count): left.names for left in source_of(world).left_out}
    assert listed == {
        ("actors", 1): ["walker"],
        ("plugins", 1): ["weather"],
        ("sensors", 2): ["crate::link::scale", "sunk::link::scale"],
        ("materials that are unknown", 1): ["Nowhere/Known (shelf::link::v)"],
        ("frictions that were clamped to 0 to 1", 2): ["floor::link::c (50)", "walls::link::c (50)"],
        ("inertias that were mended", 2): ["crate::link", "sunk::link"],
        ("meshes that cannot be read", 1): listed["meshes that cannot be read", 1],
    }
    assert listed["meshes that cannot be read", 1][0].startswith("cut.dae: it cannot be read")
    assert source_of(world).held == {
        "ghost": "it has no collision shape",
        "sunk": "it overlaps something by 100 mm",
    }


def cells(known: OccupancyMap, x0: float, y0: float, x1: float, y1: float) -> tuple[slice, slice]:
    west, south = known.origin
    size = known.resolution_m
    return slice(round((y0 - south) / size), round((y1 - south) / size)), slice(
        round((x0 - west) / size), round((x1 - west) / size)
    )


def test_its_map_shows_what_is_there(house: Path) -> None:
    """Walls of a mesh in centimetres that says Y_UP are where they are in Gazebo, and the rooms between them free."""
    known = read_map(house / "map.yaml")
    assert known.occupied is not None
    for x0, y0, z0, x1, y1, _ in WALLS:
        if z0 == 0:
            assert known.occupied[cells(known, x0, y0, x1, y1)].all()
    assert known.free[cells(known, 2.0, -0.2, 2.2, 0.4)].all()  # the doorway, with its door open
    assert known.free[cells(known, 2.4, -0.2, 4.0, 0.5)].all()
    assert known.free[cells(known, 4.3, 0.9, 4.7, 1.9)].all()  # below a table
    assert known.occupied[cells(known, -1.95, 1.55, -1.65, 2.45)].all()  # the shelf
    outside = cells(known, -2.6, -3.1, -2.3, 3.0)
    assert not known.free[outside].any()


def test_the_door_turns_and_the_crate_is_loose(house: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(house / "world.xml"))
    joints = {model.joint(number).name: int(model.jnt_type[number]) for number in range(model.njnt)}
    assert joints == {
        "crate": int(mujoco.mjtJoint.mjJNT_FREE),
        "door_leaf": int(mujoco.mjtJoint.mjJNT_HINGE),
    }
    data = mujoco.MjData(model)
    hinge = model.joint("door_leaf")
    assert hinge.range.tolist() == pytest.approx([-0.2, 1.47])
    data.qvel[hinge.dofadr[0]] = 1.0
    mujoco.mj_step(model, data, nstep=1500)
    assert 0.3 < data.qpos[hinge.qposadr[0]] < 1.5
    assert np.linalg.norm(data.body("crate").xpos - (0.8, -1.5, 0.2 + 0.0)) < 0.02


def test_pictures_are_small_and_png_and_mujoco_sees_their_colours(house: Path) -> None:
    [picture] = (house / "textures").iterdir()
    with Image.open(picture) as opened:
        assert (opened.format, opened.mode) == ("PNG", "P")
        assert max(opened.size) <= 512
        pixels = np.asarray(opened.convert("RGB"))
    model = mujoco.MjModel.from_xml_path(str(house / "world.xml"))
    [start] = model.tex_adr[model.tex_type == mujoco.mjtTexture.mjTEXTURE_2D]
    seen = model.tex_data[start : start + pixels.size].reshape(pixels.shape)
    assert (seen == pixels).all() or (seen == pixels[::-1]).all()
    assert sum(path.stat().st_size for path in house.rglob("*") if path.is_file()) < 1_000_000


@pytest.mark.deep
def test_it_has_pictures(house: Path, world: World, tmp_path: Path) -> None:
    assert len(write_pictures(world, house, tmp_path / "pictures")) == 4


def test_it_can_be_looked_at_proved_and_exported(house: Path, world: World, tmp_path: Path) -> None:
    assert b"<html" in viewer_page(house, "house").encode().lower()
    checks = prove(world, house)
    assert violations(checks) == []
    write_export_zip({"house": house}, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as export:
        names = {Path(name).name for name in export.namelist()}
    assert {"house.world", "house.glb", "house.usda", "map.pgm"} <= names


def test_the_same_files_make_the_same_bytes_wherever_they_are(house: Path, tmp_path: Path) -> None:
    path = write_house(tmp_path / "elsewhere" / "deep")
    import_gazebo_world(path, Wishes(start=Start(0.0, 0.0), notes=NOTES), tmp_path / "bundle")
    assert content_hash(tmp_path / "bundle") == content_hash(house)


def test_without_a_start_a_free_place_is_chosen(tmp_path: Path) -> None:
    world = import_gazebo_world(write_house(tmp_path / "house"), Wishes(), tmp_path / "bundle")
    assert source_of(world).is_start_chosen
    assert world.checks is not None
    assert world.checks.origin_clear
    assert [room.type for room in world.floorplan.rooms] == ["Area"]


def test_a_goal_behind_a_wall_breaks_a_guarantee(tmp_path: Path) -> None:
    notes = GazeboNotes.model_validate({"goals": {"garden": [-4.0, 0.0]}})
    world = import_gazebo_world(
        write_house(tmp_path / "house"), Wishes(start=Start(0.0, 0.0), notes=notes), tmp_path / "bundle"
    )
    assert world.checks is not None
    assert violations(world.checks) == ["garden: its goal is out of a robot's reach"]


def test_the_start_may_be_turned(tmp_path: Path) -> None:
    world = import_gazebo_world(
        write_house(tmp_path / "house"), Wishes(start=Start(0.0, 1.0, np.pi / 2), notes=NOTES), tmp_path / "bundle"
    )
    # Forwards is north now: the window, east of the start, is to the right of it.
    assert source_of(world).goals["window"] == pytest.approx((-0.8, -5.2), abs=1e-3)
    assert world.checks is not None
    assert violations(world.checks) == []


def test_held_worlds_have_no_loose_bodies(tmp_path: Path) -> None:
    world = import_gazebo_world(write_house(tmp_path / "house"), Wishes(loose="hold"), tmp_path / "bundle")
    assert not any(item.movable for item in world.furniture)
    assert "crate" in source_of(world).held


@pytest.mark.parametrize(
    ("more", "wishes", "said"),
    [
        ("<include><uri>model://shelff</uri></include>", Wishes(), "1 model or file is missing: model://shelff"),
        (
            '<model name="rock"><link name="l"><collision name="c"><geometry>'
            "<mesh><uri>rock.obj</uri></mesh></geometry></collision></link></model>",
            Wishes(),
            "1 model or file is missing: rock.obj (rock::l::c)",
        ),
        ("", Wishes(start=Start(4.2, 0.8)), "is not free within 0.5 m, on a floor at 0.03 m: furnishing_table"),
        (
            "",
            Wishes(start=Start(500.0, 0.0)),
            "there is no floor under the start (500, 0); the world reaches from (-2.2, -2.7)",
        ),
    ],
)
def test_what_cannot_be_imported_is_refused_in_words(tmp_path: Path, more: str, wishes: Wishes, said: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        import_gazebo_world(write_house(tmp_path / "house", more), wishes, tmp_path / "bundle")
    assert said in str(caught.value)
    assert not (tmp_path / "bundle").exists()


def test_missing_models_may_be_left_out(tmp_path: Path) -> None:
    more = "<include><uri>model://shelff</uri></include>"
    world = import_gazebo_world(write_house(tmp_path / "house", more), Wishes(allow_missing=True), tmp_path / "bundle")
    assert "models that are missing" in {left.what for left in source_of(world).left_out}


def test_a_world_without_a_floor_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bare.world"
    wall = '<model name="wall"><static>1</static><link name="l"/></model>'
    path.write_text(f'<sdf version="1.6"><world name="w">{wall}</world></sdf>')
    with pytest.raises(ConfigurationError, match="it has no floor"):
        import_gazebo_world(path, Wishes(), tmp_path / "bundle")
    with pytest.raises(ConfigurationError, match=r"there is no floor under the start \(1, 2\)"):
        import_gazebo_world(path, Wishes(start=Start(1.0, 2.0)), tmp_path / "bundle")


def test_a_named_pipe_or_a_folder_in_place_of_a_file_holds_nothing_up(tmp_path: Path) -> None:
    path = tmp_path / "pipe.world"
    os.mkfifo(path)
    with pytest.raises(ConfigurationError, match="no regular file"):
        import_gazebo_world(path, Wishes(), tmp_path / "bundle")


def test_the_process_that_imports_says_why_there_is_no_world(tmp_path: Path) -> None:
    path = tmp_path / "broken.world"
    path.write_text("<sdf")
    with pytest.raises(ConfigurationError, match="not well-formed"):
        write_gazebo_bundle(GazeboImport(path), tmp_path / "bundle")
