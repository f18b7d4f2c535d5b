"""GLB files, read by trimesh, hold what the MJCF shows."""

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from prefect_robomaker.tasks.worldforge.exports.export_meshes import capsule_mesh, unit_mesh
from prefect_robomaker.tasks.worldforge.exports.export_scene import Kind, make_scene, read_scene
from prefect_robomaker.tasks.worldforge.exports.glb import scene_glb, world_glb

Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def load(content: bytes) -> trimesh.Scene:
    return trimesh.load_scene(trimesh.util.wrap_as_stream(content), file_type="glb")


def document_of(content: bytes) -> dict:
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON"
    return json.loads(content[20 : 20 + size])


@pytest.fixture(scope="session")
def first(bundles: dict[str, Path]) -> Path:
    """A bundle with doors and pictures."""
    return next(iter(bundles.values()))


def test_another_reader_finds_every_drawn_shape_where_mujoco_has_it(first: Path) -> None:
    scene = read_scene(first)
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    read = load(world_glb(first))
    names: dict[str, list[np.ndarray]] = {}
    for node in read.graph.nodes_geometry:
        transform, _ = read.graph[node]
        names.setdefault(node, []).append(transform[:3, 3])
    places = np.concatenate(list(names.values()))
    drawn = 0
    for geom in range(scene.model.ngeom):
        group = scene.model.geom_group[geom]
        if group in (3, 4) or scene.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        if scene.model.geom(geom).name.startswith("ceiling_"):  # its node is where its lower face is
            continue
        place = Y_UP @ data.geom_xpos[geom]
        assert np.abs(places - place).max(axis=1).min() < 1e-3, scene.model.geom(geom).name
        drawn += 1
    assert drawn > 200
    assert len(places) >= drawn


def test_bounds_are_those_of_the_mjcf(first: Path) -> None:
    scene = read_scene(first)
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    corners = []
    for geom in np.flatnonzero((scene.model.geom_group != 3) & (scene.model.geom_group != 4)):
        if scene.model.geom(geom).name.startswith("ceiling_"):
            continue
        if scene.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = scene.model.mesh(scene.model.geom_dataid[geom])
            start, number = mesh.vertadr[0], mesh.vertnum[0]
            turned = scene.model.mesh_vert[start : start + number] @ data.geom_xmat[geom].reshape(3, 3).T
            corners += list(data.geom_xpos[geom] + turned)
            continue
        # Of a box, cylinder or ellipsoid alike: its box about its own axes.
        half, turn = scene.model.geom_aabb[geom, 3:].copy(), data.geom_xmat[geom].reshape(3, 3)
        middle = data.geom_xpos[geom] + turn @ scene.model.geom_aabb[geom, :3]
        if scene.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            half = np.array([*scene.model.geom_size[geom, :2], 0])
        reach = np.abs(turn) @ half
        corners += [middle - reach, middle + reach]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    bounds = load(world_glb(first)).bounds
    assert bounds[0] == pytest.approx([low[0], low[2], -high[1]], abs=1e-3)
    assert bounds[1] == pytest.approx([high[0], high[2], -low[1]], abs=1e-3)


def test_things_are_nodes_with_their_names(first: Path) -> None:
    document = document_of(world_glb(first))
    world = document["nodes"][document["scenes"][0]["nodes"][0]]
    names = [document["nodes"][child]["name"] for child in world["children"]]
    scene = read_scene(first)
    assert names == [thing.name for thing in scene.things]
    doors = {passage.door.id for passage in scene.world.floorplan.passages if passage.door}
    assert {"building", *(item.id for item in scene.world.furniture), *doors} == set(names)


def test_floors_and_walls_keep_their_pictures(first: Path) -> None:
    content = world_glb(first)
    document = document_of(content)
    start = 20 + struct.unpack_from("<I", content, 12)[0] + 8
    pictures = {}
    for image in document["images"]:
        view = document["bufferViews"][image["bufferView"]]
        pictures[image["name"]] = content[start + view["byteOffset"] :][: view["byteLength"]]
    files = {path.stem: path.read_bytes() for path in (first / "textures").glob("*.png") if path.stem != "sky"}
    assert pictures == files


def test_a_metre_of_wall_shows_as_much_of_its_picture_everywhere() -> None:
    """Texture coordinates grow with the wall, not with the mesh; MuJoCo lays `texrepeat` pictures on two metres."""
    xml = """<mujoco><asset><texture name="t" type="2d" builtin="checker" width="8" height="8" rgb1="1 0 0"/>
    <material name="t" texture="t" texrepeat="2 4" texuniform="true"/></asset>
    <worldbody><geom name="wall_0" type="box" size="3 .5 .1" material="t"/></worldbody></mujoco>"""
    mesh = next(iter(load(scene_glb(_empty(xml))).geometry.values()))
    uv = mesh.visual.uv[np.abs(mesh.vertex_normals[:, 2]) > 0.9]
    assert np.ptp(uv, axis=0) == pytest.approx([2 * 6 / 2, 4 * 1 / 2])


def _empty(xml: str):
    from prefect_robomaker.schemas.worlds.world import Floorplan, World

    plan = Floorplan.model_construct(footprint=[], ceiling_height_m=2.5, rooms=[], walls=[], passages=[], wishes=[])
    world = World.model_construct(generator_version="0", floorplan=plan, furniture=[], wishes=[])
    return make_scene(world, mujoco.MjModel.from_xml_string(xml))


def test_colours_are_linear_and_glass_lets_light_through() -> None:
    xml = """<mujoco><worldbody><geom type="sphere" size=".5" rgba="1 .5 0 .25"/></worldbody></mujoco>"""
    (material,) = document_of(scene_glb(_empty(xml)))["materials"]
    assert material["alphaMode"] == "BLEND"
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([1, 0.214, 0, 0.25], abs=1e-3)


@pytest.mark.parametrize("kind", ["box", "sphere", "ellipsoid", "cylinder"])
def test_unit_meshes_are_closed_and_face_outwards(kind: Kind) -> None:
    mesh = unit_mesh(kind).apart()
    solid = trimesh.Trimesh(mesh.positions, mesh.triangles, process=True, merge_norm=True, merge_tex=True)
    volume = {"box": 8.0, "cylinder": 2 * np.pi}.get(kind, 4 / 3 * np.pi)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(volume, rel=0.04)
    assert solid.bounds == pytest.approx(np.array([[-1.0] * 3, [1.0] * 3]))
    flat = np.cross(
        mesh.positions[mesh.triangles[:, 1]] - mesh.positions[mesh.triangles[:, 0]],
        mesh.positions[mesh.triangles[:, 2]] - mesh.positions[mesh.triangles[:, 0]],
    )
    assert (np.einsum("ij,ij->i", flat, mesh.normals[mesh.triangles].sum(axis=1)) > 0).all()


def test_a_capsule_keeps_round_ends() -> None:
    mesh = capsule_mesh(0.2, 0.5)
    solid = trimesh.Trimesh(mesh.positions, mesh.triangles, process=True, merge_norm=True)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(np.pi * 0.04 * 1.0 + 4 / 3 * np.pi * 0.008, rel=0.04)
    assert solid.bounds[1] == pytest.approx([0.2, 0.2, 0.7])


def test_equal_bundles_make_equal_files(first: Path) -> None:
    assert world_glb(first) == world_glb(first)


@pytest.mark.deep
def test_equal_bundles_make_equal_files_in_every_process(first: Path) -> None:
    """The writer keeps its parts in tables whose keys are hashes."""
    code = (
        "import sys, pathlib; from prefect_robomaker.tasks.worldforge.exports.glb import world_glb; "
        "sys.stdout.buffer.write(world_glb(pathlib.Path(sys.argv[1])))"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "1"}
    made = subprocess.run([sys.executable, "-c", code, str(first)], env=environment, capture_output=True, check=True)
    assert made.stdout == world_glb(first)


def test_views_that_several_accessors_share_have_a_stride(first: Path) -> None:
    """glTF asks for it; equal places and normals, such as a ball's, are stored once."""
    document = document_of(world_glb(first))
    vertices = [accessor for accessor in document["accessors"] if accessor["type"] != "SCALAR"]
    strides = {"VEC2": 8, "VEC3": 12}
    for accessor in vertices:
        assert document["bufferViews"][accessor["bufferView"]]["byteStride"] == strides[accessor["type"]]


def test_parts_keep_their_own_names(first: Path) -> None:
    """Things have parts of the same name, which other readers would have to keep apart."""
    document = document_of(world_glb(first))
    nodes = {node["name"]: node for node in document["nodes"] if "children" in node}
    scene = read_scene(first)
    for thing in scene.things:
        drawn = [shape.name for shape in thing.shapes if shape.drawn and not shape.endless]
        assert [document["nodes"][child]["name"] for child in nodes[thing.name]["children"]] == drawn
