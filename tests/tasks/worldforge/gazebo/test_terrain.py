"""Terrain: its surface is the same in the world, in its exports, and in a world that is imported from these."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from prefect_robomaker.schemas.worlds.world import GazeboSource, World
from prefect_robomaker.tasks.runtime.episode.occupancy_map import read_map
from prefect_robomaker.tasks.worldforge.exports.export import write_export_zip
from prefect_robomaker.tasks.worldforge.exports.export_meshes import terrain_mesh
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world
from prefect_robomaker.tasks.worldforge.gazebo.terrain import terrain_of
from prefect_robomaker.tasks.worldforge.viewer.viewer_page import viewer_page


def hills(folder: Path, samples: int, shapes: str) -> Path:
    """Writes a world of hills around a level middle, 24 m by 20 m and 3 m high."""
    y, x = np.mgrid[-1 : 1 : samples * 1j, -1 : 1 : samples * 1j]
    away = np.hypot(x, y)
    heights = np.clip(4 * away**2 + np.sin(7 * x) * np.cos(5 * y) * away, 0, None) * (away > 0.3)
    Image.fromarray((heights / heights.max() * 255).astype(np.uint8)).save(folder / "hills.png")
    terrain = "<geometry><heightmap><uri>hills.png</uri><size>24 20 3</size><pos>0 0 0.2</pos></heightmap></geometry>"
    inner = "".join(f'<{shape} name="{shape}">{terrain}</{shape}>' for shape in shapes.split())
    path = folder / "hills.world"
    path.write_text(
        '<sdf version="1.6"><world name="w"><model name="hills"><static>true</static><pose>1 2 0 0 0 0</pose>'
        f'<link name="l">{inner}</link></model><model name="crate"><pose>2 0.5 0.41 0 0 0</pose><link name="l">'
        '<collision name="c"><geometry><box><size>0.4 0.4 0.4</size></box></geometry></collision></link></model>'
        "</world></sdf>"
    )
    return path


def exported(bundle: Path, folder: Path) -> Path:
    """Unpacks an export of a world called `hills`; returns the folder of its files."""
    write_export_zip({"hills": bundle}, folder / "export.zip")
    with zipfile.ZipFile(folder / "export.zip") as archive:
        archive.extractall(folder / "export")
    [path] = (folder / "export").rglob("hills.world")
    return path.parent


def again(bundle: Path, folder: Path) -> tuple[World, Path]:
    """Imports the export of a world in Gazebo's format; returns that and its bundle."""
    there = exported(bundle, folder)
    models = list((folder / "export").rglob("models"))
    wishes = Wishes(models, Start(0.0, 0.0))
    return import_gazebo_world(there / "hills.world", wishes, folder / "again"), folder / "again"


def surface_m(bundle: Path, spots: np.ndarray) -> np.ndarray:
    """Heights of what collides, along rays from above."""
    model = mujoco.MjModel.from_xml_path(str(bundle / "world.xml"))
    is_seen_only = (model.geom_contype == 0) & (model.geom_conaffinity == 0)
    model.geom_group[:] = np.where(is_seen_only, 1, 0)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    groups, down = np.array([1, 0, 0, 0, 0, 0], np.uint8), np.array([0.0, 0.0, -1.0])
    return np.array([
        9 - mujoco.mj_ray(model, data, np.array([x, y, 9.0]), down, groups, True, -1, np.zeros(1, np.int32))
        for x, y in spots
    ])  # fmt: skip


@pytest.mark.parametrize("samples", [17, 129])
def test_an_export_has_the_surface_and_brings_it_back(tmp_path: Path, samples: int) -> None:
    """The finest has more triangles than a mesh may have prisms."""
    world = import_gazebo_world(
        hills(tmp_path, samples, "collision visual"), Wishes(start=Start(0.0, 0.0)), tmp_path / "bundle"
    )
    assert world.checks is not None
    back, bundle = again(tmp_path / "bundle", tmp_path)
    assert isinstance(back.source, GazeboSource)
    assert back.source.left_out == []
    spots = np.random.default_rng(3).uniform((-10, -7), (12, 11), (500, 2))
    before, after = surface_m(tmp_path / "bundle", spots), surface_m(bundle, spots)
    assert np.ptp(before) > 1.5
    assert np.abs(before - after).max() < 0.01

    one, other = read_map(tmp_path / "bundle" / "map.yaml"), read_map(bundle / "map.yaml")
    assert one.occupied is not None
    assert other.occupied is not None
    assert one.occupied.shape == other.occupied.shape
    assert min((one.occupied == other.occupied).mean(), (one.free == other.free).mean()) >= 0.99
    assert 0.01 < one.free.mean() < 0.5
    assert back.checks is not None
    assert back.checks.reachable_m2 == pytest.approx(world.checks.reachable_m2, rel=0.02)
    assert back.checks.free_bodies == world.checks.free_bodies == 1


def test_viewers_and_isaac_sim_get_the_surface(tmp_path: Path) -> None:
    import_gazebo_world(hills(tmp_path, 17, "collision"), Wishes(start=Start(0.0, 0.0)), tmp_path / "bundle")
    there = exported(tmp_path / "bundle", tmp_path)
    scene = trimesh.load(there / "hills.glb")
    assert isinstance(scene, trimesh.Scene)
    low, high = scene.bounds  # y points up in GLB; a base of 0.1 m is below the lowest spot
    assert low.tolist() == pytest.approx([-11, -0.1, -12], abs=0.01)
    assert high.tolist() == pytest.approx([13, 3, 8], abs=0.01)
    stage = (there / "hills.usda").read_text()
    mesh = stage[stage.index('def Mesh "hills_s0"') :]
    # The hull of hills would fill the valley between them, and hold the crate in the air.
    assert mesh.index('physics:approximation = "none"') < mesh.index("def Xform")
    assert "GLTFLoader" in viewer_page(tmp_path / "bundle", "hills")


def test_cameras_see_terrain_and_what_is_only_drawn_is_listed(tmp_path: Path) -> None:
    import_gazebo_world(hills(tmp_path, 17, "collision visual"), Wishes(start=Start(0.0, 0.0)), tmp_path / "bundle")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "bundle" / "world.xml"))
    assert model.geom_group[model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD].tolist() == [0]
    path = hills(tmp_path, 17, "visual")
    path.write_text(path.read_text().replace("</world>", "<include><uri>model://ground_plane</uri></include></world>"))
    world = import_gazebo_world(path, Wishes(start=Start(0.0, 0.0)), tmp_path / "drawn")
    assert isinstance(world.source, GazeboSource)
    assert [(left.what, left.names) for left in world.source.left_out] == [
        ("heightmaps that are drawn only", ["hills::l::visual"])
    ]


def field(heights: np.ndarray) -> mujoco.MjModel:
    """A height field of 6 m by 4 m and 2 m."""
    shares = " ".join(map(str, heights.ravel()))
    rows, columns = heights.shape
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><hfield name="f" nrow="{rows}" ncol="{columns}" size="3 2 2 0.1" elevation="{shares}"/>'
        '</asset><worldbody><geom type="hfield" hfield="f"/></worldbody></mujoco>'
    )


@given(seed=st.integers(0, 2**31), rows=st.integers(3, 5), columns=st.integers(3, 5))
def test_triangles_of_exports_are_those_that_rays_hit(seed: int, rows: int, columns: int) -> None:
    chance = np.random.default_rng(seed)
    model = field(chance.uniform(0, 1, (rows, columns)))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mesh = terrain_mesh(model, 0)
    corners = mesh.positions[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    surface = corners[normals[:, 2] > 1e-9]
    assert len(surface) == 2 * (rows - 1) * (columns - 1)
    for triangle in surface:
        x, y, z = chance.dirichlet((1, 1, 1)) @ triangle
        down = np.array([0.0, 0.0, -1.0])
        hit = mujoco.mj_ray(model, data, np.array([x, y, 9.0]), down, None, True, -1, np.zeros(1, np.int32))
        assert 9 - hit == pytest.approx(z, abs=1e-5)
    # Seen from outside: the normals of a closed surface point away from what it holds.
    volume = np.einsum("ij,ij->i", corners[:, 0], normals).sum() / 6
    assert volume > 6 * 4 * 0.1 * 0.99
    assert (np.einsum("ij,ij->i", mesh.normals[mesh.triangles[:, 0]], normals) > -1e-9).all()
    found = terrain_of(corners)
    assert found is not None
    assert found.is_closed
    expected = model.hfield_data.reshape(rows, columns) * 2
    assert found.heights_m == pytest.approx(expected, abs=1e-5)
    assert [*found.size, *found.lowest] == pytest.approx([6, 4, 2, 0, 0, 0], abs=1e-5)


def grid(heights: np.ndarray, *, along: bool = True) -> np.ndarray:
    """Triangles over a grid of cells of 1 m, cut from south-west to north-east, or the other way."""
    rows, columns = heights.shape
    points = np.dstack([*np.meshgrid(np.arange(columns), np.arange(rows)), heights]).astype(np.float64)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    cut = [(a, b, c), (a, c, d)] if along else [(a, b, d), (b, c, d)]
    return np.concatenate([np.stack(each, axis=2).reshape(-1, 3, 3) for each in cut])


def test_what_is_no_terrain_is_not_taken_for_it() -> None:
    bumps = np.random.default_rng(1).uniform(0, 1, (6, 5))
    whole = grid(bumps)
    assert terrain_of(whole) is not None
    assert terrain_of(grid(bumps * 0.004, along=False)) is not None
    assert terrain_of(grid(bumps, along=False)) is None  # its ridges would be valleys
    assert terrain_of(whole[1:]) is None  # a hole
    assert terrain_of(np.concatenate([whole[1:], whole[:1] + np.array([0, 0, 2.0])])) is None  # a piece hovers
    assert terrain_of(whole[:, ::-1]) is None  # a ceiling
    assert terrain_of(np.concatenate([whole, whole[:, ::-1] - [0, 0, 0.3]])) is None  # a roof with an underside
    uneven = whole * [1, 1, 1]
    uneven[..., 0] = np.where(uneven[..., 0] == 1, 1.3, uneven[..., 0])
    assert terrain_of(uneven) is None
