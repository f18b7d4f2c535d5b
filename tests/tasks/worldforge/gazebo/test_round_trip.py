"""A world that is exported for Gazebo and imported again has the same map and the same joints."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import zipfile
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from helpers.paths import REPOSITORY
from scipy import ndimage

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.schemas.worlds.world import GazeboSource, World
from prefect_robomaker.tasks.runtime.episode.occupancy_map import OccupancyMap, read_map
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import Source, import_world
from prefect_robomaker.tasks.worldforge.exports.export import write_export_zip
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world
from prefect_robomaker.tasks.worldforge.generator import generate_world

FLAT = REPOSITORY / "deployments" / "specs" / "plans" / "flat.svg"


def near(one: np.ndarray, of: OccupancyMap, other: np.ndarray, of_other: OccupancyMap) -> float:
    """Share of cells that have one of the other map's within one cell."""
    rows, columns = np.nonzero(one)
    shift = np.round((np.array(of.origin) - of_other.origin) / of.resolution_m).astype(int)
    wide = np.pad(ndimage.binary_dilation(other, np.ones((3, 3), np.bool_)), 40)
    return float(wide[rows + shift[1] + 40, columns + shift[0] + 40].mean())


def drawn() -> World:
    """A flat that somebody drew, with five doors."""
    return import_world(Source(FLAT), DrawingNotes(), 7)


def generated(*rooms: tuple[str, str, float], density: str) -> World:
    """A generated world with these rooms: name, type and area."""
    shape = {"AspectRatio": {"x": 4.0, "y": 3.0}}
    named = [{"Name": name, "Type": of, "DesiredShape": {"Area": area, **shape}} for name, of, area in rooms]
    arrangement = {
        "Name": "all",
        "TargetSet": {"RoomNames": [name for name, _, _ in rooms]},
        "DesiredSpatialDensity": density,
    }
    floor = {
        "Floorplan": {"Rooms": named},
        "Interior": {"Furniture": {"FurnitureArrangements": [arrangement]}},
    }
    return generate_world(WorldTemplateBody.model_validate({"Buildings": [{"Floors": [floor]}]}), 3, 5)


KINDS: dict[str, Callable[[], World]] = {
    "drawn": drawn,
    "flat": lambda: generated(
        ("Living", "Living", 26.0),
        ("Kitchen", "Kitchen", 14.0),
        ("Bedroom", "Bedroom", 16.0),
        ("Bath", "Bathroom", 10.0),
        density="Sparse",
    ),
    "house": lambda: generated(
        ("Hallway", "Hallway", 14.0),
        ("Living", "Living", 32.0),
        ("Dining", "Dining", 16.0),
        ("Guest room", "Bedroom", 13.0),
        ("Closet", "Closet", 10.0),
        density="Dense",
    ),
}


@pytest.mark.deep
@pytest.mark.parametrize("kind", KINDS)
def test_the_map_of_an_exported_world_comes_back(kind: str, tmp_path: Path) -> None:
    made = KINDS[kind]()
    write_bundle(made, tmp_path / "bundle")
    write_export_zip({"flat": tmp_path / "bundle"}, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        archive.extractall(tmp_path / "export")
    [path] = (tmp_path / "export").rglob("*.world")
    [models] = (tmp_path / "export").rglob("models")
    world = import_gazebo_world(path, Wishes([models], Start(0.0, 0.0)), tmp_path / "again")

    before, after = read_map(path.parent / "map.yaml"), read_map(tmp_path / "again" / "map.yaml")
    assert before.occupied is not None
    assert after.occupied is not None
    shares = [
        share
        for one, other in ((before.free, after.free), (before.occupied, after.occupied))
        for share in (near(one, before, other, after), near(other, after, one, before))
    ]
    print(kind, [round(share, 4) for share in shares], held(world))
    assert min(shares) >= 0.99
    assert world.checks is not None
    assert made.checks is not None
    assert world.checks.free_bodies >= made.checks.free_bodies - len(held(world))
    assert kind != "drawn" or world.checks.free_bodies == 15  # five doors, and loose things


def held(world: World) -> dict[str, str]:
    assert isinstance(world.source, GazeboSource)
    return world.source.held


ARM = """<model name="crane"><pose>3 0 0 0 0 0.5</pose>
<link name="post"><pose>0 0 0.5 0 0 0</pose><inertial><mass>20</mass></inertial>
<collision name="c"><geometry><box><size>0.3 0.3 1</size></box></geometry></collision>
<visual name="v"><geometry><box><size>0.3 0.3 1</size></box></geometry></visual></link>
<link name="jib"><pose>0.4 0 1.1 0 0 0</pose><inertial><mass>2</mass></inertial>
<collision name="c"><geometry><box><size>1 0.1 0.1</size></box></geometry></collision>
<visual name="v"><geometry><box><size>1 0.1 0.1</size></box></geometry></visual></link>
<link name="hook"><pose>0.85 0 0.8 0 0 0</pose><inertial><mass>1</mass></inertial>
<collision name="c"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision></link>
<joint name="foot" type="fixed"><parent>world</parent><child>post</child></joint>
<joint name="turn" type="revolute"><parent>post</parent><child>jib</child><pose>-0.4 0 0 0 0 0</pose>
<axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>2</upper></limit><dynamics><damping>3</damping></dynamics></axis>
</joint>
<joint name="rope" type="ball"><parent>jib</parent><child>hook</child><pose>0 0 0.3 0 0 0</pose></joint></model>"""


def jointed(path: Path) -> dict[str, tuple[int, list[float], list[float], list[float]]]:
    """Kind, anchor, axis and limits of each joint of a world, by the place of its body."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {
        " ".join(f"{value:.3f}" for value in data.xipos[model.jnt_bodyid[joint]] + 0.0): (
            int(model.jnt_type[joint]),
            np.round(data.xanchor[joint], 3).tolist(),
            np.round(data.xaxis[joint], 3).tolist() if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE else [],
            np.round(model.jnt_range[joint], 3).tolist(),
        )
        for joint in range(model.njnt)
    }


def test_bodies_that_hang_on_bodies_come_back(tmp_path: Path) -> None:
    """A crane with a jib on its post and a hook on the jib, exported as SDF, USD and GLB."""
    path = tmp_path / "some.world"
    path.write_text(
        f'<sdf version="1.7"><world name="w"><include><uri>model://ground_plane</uri></include>{ARM}</world></sdf>'
    )
    start = Wishes(start=Start(0.0, 0.0))
    import_gazebo_world(path, start, tmp_path / "bundle")
    before = jointed(tmp_path / "bundle" / "world.xml")
    assert [each[0] for each in before.values()] == [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_BALL)]
    write_export_zip({"crane": tmp_path / "bundle"}, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        archive.extractall(tmp_path / "export")
    [exported] = (tmp_path / "export").rglob("crane.world")
    [models] = (tmp_path / "export").rglob("models")
    import_gazebo_world(exported, Wishes([models], Start(0.0, 0.0)), tmp_path / "again")
    assert jointed(tmp_path / "again" / "world.xml") == before

    stage = exported.with_name("crane.usda").read_text()
    assert "rel physics:body0 = </World/crane_jib>" in stage
    assert 'def PhysicsSphericalJoint "hinge"' in stage
    scene = trimesh.load(exported.with_name("crane.glb"))
    assert isinstance(scene, trimesh.Scene)
    low, high = scene.bounds  # y points up in GLB
    assert (round(float(low[1]), 2), round(float(high[1]), 2)) == (0.0, 1.15)
