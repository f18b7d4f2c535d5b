"""USD stages, read by USD's own library, hold the poses, sizes, names and physics of the world."""

import json
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.client_environments import run_client, usd_environment

from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world
from prefect_robomaker.tasks.worldforge.exports.export_scene import read_scene
from prefect_robomaker.tasks.worldforge.exports.usd_text import PrimNames, numbers, quaternion, vectors

READ = """
import json, sys
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation
stage = Usd.Stage.Open(sys.argv[1])
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
errors = UsdValidation.ValidationContext(validators).Validate(stage)
places = UsdGeom.XformCache()
boxes = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default", "guide"])
things, joints, solids = {}, {}, {}
for prim in stage.GetDefaultPrim().GetChildren():
    if prim.GetTypeName() != "Xform":
        continue
    matrix = places.GetLocalToWorldTransform(prim)
    mass = UsdPhysics.MassAPI(prim)
    body = prim.HasAPI(UsdPhysics.RigidBodyAPI)
    things[prim.GetDisplayName() or prim.GetName()] = {
        "place": list(matrix.ExtractTranslation()),
        "turn": [list(row)[:3] for row in matrix][:3],
        "size": list(boxes.ComputeUntransformedBound(prim).ComputeAlignedRange().GetSize()),
        "mass": mass.GetMassAttr().Get() if body else None,
        "moments": list(mass.GetDiagonalInertiaAttr().Get()) if body else None,
        "asleep": UsdPhysics.RigidBodyAPI(prim).GetStartsAsleepAttr().Get() if body else None,
    }
    for child in prim.GetChildren():
        if child.IsA(UsdPhysics.RevoluteJoint):
            joint = UsdPhysics.RevoluteJoint(child)
            world, own = joint.GetLocalRot0Attr().Get(), joint.GetLocalRot1Attr().Get()
            joints[prim.GetDisplayName() or prim.GetName()] = {
                "axis": joint.GetAxisAttr().Get(),
                "limits": [joint.GetLowerLimitAttr().Get(), joint.GetUpperLimitAttr().Get()],
                "body0": [str(path) for path in joint.GetBody0Rel().GetTargets()],
                "body1": [str(path) for path in joint.GetBody1Rel().GetTargets()],
                "place": list(joint.GetLocalPos0Attr().Get()),
                "own": list(matrix.Transform(Gf.Vec3d(joint.GetLocalPos1Attr().Get()))),
                "turn": list(Gf.Rotation(Gf.Quatd(world)).TransformDir(Gf.Vec3d(0, 0, 1))),
                "own_turn": list(matrix.TransformDir(Gf.Rotation(Gf.Quatd(own)).TransformDir(Gf.Vec3d(0, 0, 1)))),
            }
        if child.HasAPI(UsdPhysics.CollisionAPI):
            material = UsdShade.MaterialBindingAPI(child).ComputeBoundMaterial("physics")[0]
            solids[f"{prim.GetName()}/{child.GetDisplayName() or child.GetName()}"] = [
                child.GetTypeName(),
                list(places.GetLocalToWorldTransform(child).ExtractTranslation()),
                UsdPhysics.MaterialAPI(material).GetStaticFrictionAttr().Get(),
                list(boxes.ComputeWorldBound(child).ComputeAlignedRange().GetSize()),
            ]
meshes, uneven = {}, []
for prim in stage.Traverse():
    if not prim.IsA(UsdGeom.Mesh):
        continue
    mesh, picture = UsdGeom.Mesh(prim), UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
    corners, points = mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetPointsAttr().Get()
    many = {"faceVarying": len(corners), "vertex": len(points)}
    normals, how = mesh.GetNormalsAttr().Get(), mesh.GetNormalsInterpolation()
    meshes[how] = meshes.get(how, 0) + 1
    if len(normals) != many[how] or picture.HasValue() and len(picture.Get()) != many[picture.GetInterpolation()]:
        uneven.append(str(prim.GetPath()))
    for corner in range(0, len(corners), 3):
        one, two, three = (points[at] for at in corners[corner : corner + 3])
        normal = normals[corner if how == "faceVarying" else corners[corner]]
        face = Gf.Cross(two - one, three - one)
        if how == "faceVarying" and face.GetLength() > 1e-9 and Gf.Dot(face.GetNormalized(), normal) < 0.99:
            uneven.append(f"{prim.GetPath()}: {corner}")
print(json.dumps({
    "meshes": meshes, "uneven": uneven[:5],
    "errors": [f"{error.GetName()}: {error.GetMessage()}" for error in errors], "things": things, "joints": joints,
    "solids": solids, "up": UsdGeom.GetStageUpAxis(stage), "metres": UsdGeom.GetStageMetersPerUnit(stage),
    "kilograms": UsdPhysics.GetStageKilogramsPerUnit(stage),
}))
"""


@pytest.fixture(scope="module")
def world_folder(exported: Path) -> Path:
    """An exported world with doors, pictures and loose objects."""
    return next(iter(sorted((exported / "aws_robomaker_worldforge_worlds" / "worlds").iterdir())))


@pytest.fixture(scope="module")
def stage(world_folder: Path, request: pytest.FixtureRequest) -> dict[str, Any]:
    python = usd_environment(request.config) / "python"
    file = world_folder / f"{world_folder.name}.usda"
    return json.loads(run_client([str(python), "-c", READ, str(file)], {}))


@pytest.mark.deep
def test_its_names_are_names_of_usd_and_it_names_no_picture_outside(world_folder: Path) -> None:
    text = (world_folder / f"{world_folder.name}.usda").read_text()
    names = re.findall(r'^ *def \w+ "([^"]*)"', text, re.M)
    assert len(names) > 300
    assert all(re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name) for name in names)
    pictures = set(re.findall("@(.*?)@", text))
    assert len(pictures) >= 3
    assert all(picture.startswith("./textures/") and (world_folder / picture).is_file() for picture in pictures)


def test_names_that_become_alike_stay_apart() -> None:
    names = PrimNames()
    assert [names.take(text) for text in ("leg-1", "leg.1", "1", "")] == ["leg_1", "leg_1_2", "_1", "_"]


@pytest.mark.parametrize("shape", [(0, 3), (1, 2), (200, 3)])
def test_an_array_is_written_as_its_vectors_are(shape: tuple[int, int]) -> None:
    generator = np.random.default_rng(1)
    rows = generator.normal(size=shape) * 10.0 ** generator.integers(-12, 8, size=shape)
    rows[:1, 0] = -0.0
    assert vectors(rows) == f"[{', '.join(map(numbers, rows.tolist()))}]"


def test_a_rotation_is_told_whatever_its_angle() -> None:
    generator = np.random.default_rng(1)
    for given in [*generator.normal(size=(50, 4)), *np.eye(4), [1.0, 1, 0, 0], [0, 1.0, -1, 0]]:
        matrix, back = np.zeros(9), np.zeros(9)
        mujoco.mju_quat2Mat(matrix, np.array(given) / np.linalg.norm(given))
        told = np.array(json.loads(quaternion(matrix.reshape(3, 3)).replace("(", "[").replace(")", "]")))
        mujoco.mju_quat2Mat(back, told / np.linalg.norm(told))
        assert np.abs(matrix - back).max() < 1e-5


@pytest.mark.deep
def test_usd_s_own_validators_find_nothing(stage: dict[str, Any]) -> None:
    assert stage["errors"] == []
    assert stage["uneven"] == [], "each mesh has as many normals and places on pictures as it says"
    assert stage["meshes"]["faceVarying"] > stage["meshes"]["vertex"] > 0
    assert (stage["up"], stage["metres"], stage["kilograms"]) == ("Z", 1.0, 1.0)


@pytest.mark.deep
def test_things_stand_where_the_world_says_and_have_its_sizes(stage: dict[str, Any], world_folder: Path) -> None:
    world = read_world(world_folder)
    assert len(world.furniture) > 15
    for item in world.furniture:
        thing = stage["things"][item.id]
        assert thing["place"] == pytest.approx([item.x, item.y, item.base_m], abs=1e-3), item.id
        ahead = [np.cos(item.yaw), np.sin(item.yaw), 0.0]
        assert thing["turn"][0] == pytest.approx(ahead, abs=2e-3), item.id
        more = np.array(thing["size"]) - [item.depth_m, item.width_m, item.height_m]
        # Furniture is rounder than its footprint by up to two centimetres, and handles of cups reach out of it.
        assert np.abs(more[:2]).max() < (0.05 if item.model_type == "Cup" else 0.025), item.id
        assert more[2] > -0.011, item.id


@pytest.mark.deep
def test_it_has_the_physics_of_the_mjcf(stage: dict[str, Any], world_folder: Path, bundles: dict[str, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(bundles[world_folder.name] / "world.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = {model.body(body).name: body for body in range(1, model.nbody)}
    moving = {name: thing for name, thing in stage["things"].items() if thing["mass"] is not None}
    assert set(moving) == set(bodies)
    for name, thing in moving.items():
        body = bodies[name]
        assert thing["place"] == pytest.approx(data.xpos[body].tolist(), abs=1e-4)
        assert thing["mass"] == pytest.approx(model.body_mass[body], rel=1e-4)
        assert sorted(thing["moments"]) == pytest.approx(sorted(model.body_inertia[body].tolist()), rel=1e-3)
        assert thing["asleep"] == (name not in stage["joints"])
    colliding = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    assert len(stage["solids"]) == len(colliding)
    places, frictions, sizes = (np.array([solid[at] for solid in stage["solids"].values()]) for at in (1, 2, 3))
    for geom in colliding:
        nearest = np.abs(places - data.geom_xpos[geom]).max(axis=1)
        assert nearest.min() < 1e-3, model.geom(int(geom)).name
        here = frictions[nearest < 1e-3]
        assert np.abs(here - model.geom_friction[geom, 0]).min() < 1e-3
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
            size = 2 * np.abs(data.geom_xmat[geom].reshape(3, 3)) @ model.geom_aabb[geom, 3:]
            assert np.abs(sizes[nearest < 1e-3] - size).max(axis=1).min() < 3e-3, model.geom(int(geom)).name
    kinds = [solid[0] for solid in stage["solids"].values()]
    assert set(kinds) <= {"Cube", "Cylinder", "Sphere", "Plane", "Mesh"}
    rounded = model.geom_type[colliding] == mujoco.mjtGeom.mjGEOM_ELLIPSOID
    assert kinds.count("Mesh") == np.count_nonzero(rounded), "what collides stays a primitive"


@pytest.mark.deep
def test_doors_hang_on_hinges(stage: dict[str, Any], world_folder: Path, bundles: dict[str, Path]) -> None:
    scene = read_scene(bundles[world_folder.name])
    doors = {thing.name: thing for thing in scene.things if thing.joint}
    assert set(stage["joints"]) == set(doors)
    assert doors
    for name, said in stage["joints"].items():
        joint = doors[name].joint
        assert joint is not None
        assert (said["axis"], said["body0"]) == ("Z", [])
        assert said["body1"] == [f"/World/{name.replace('-', '_')}"]
        # Both frames are the same one in the world.
        assert said["own"] == pytest.approx(said["place"], abs=1e-5)
        assert said["own_turn"] == pytest.approx(said["turn"], abs=1e-5)
        assert said["turn"] == pytest.approx((doors[name].rotation @ joint.axis).tolist(), abs=1e-5)
        assert said["limits"] == pytest.approx(np.degrees([joint.lower, joint.upper]).tolist(), abs=1e-3)
