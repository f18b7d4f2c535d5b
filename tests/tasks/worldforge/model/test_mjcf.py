"""The MJCF of a world: what a simulation, a lidar and a robot find in it."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.materials.materials import FLOORS
from prefect_robomaker.tasks.worldforge.model.mjcf import proof_mjcf, surfaces, world_mjcf

from ..conftest import MakeBody

ROBOT = """
<mujoco model="robot">
  <worldbody>
    <body name="base" pos="0 0 0.1"><freejoint/><geom name="ground" type="sphere" size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model(flat: World) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(world_mjcf(flat))


def names(model: mujoco.MjModel) -> list[str]:
    return [model.geom(index).name for index in range(model.ngeom)]


def test_it_needs_no_other_file(flat: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "file=" not in world_mjcf(flat)
    assert mujoco.MjModel.from_xml_string(world_mjcf(flat)).ngeom < 450


def test_simulation_options_are_those_that_were_chosen(model: mujoco.MjModel) -> None:
    assert model.opt.timestep == 0.002
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.impratio == 10
    assert model.opt.enableflags == 0


def test_only_loose_objects_are_bodies(flat: World, model: mujoco.MjModel) -> None:
    bodies = {model.body(index).name for index in range(1, model.nbody)}
    assert bodies == {item.id for item in flat.furniture if item.movable}
    assert bodies


def test_every_piece_has_its_geoms_and_nothing_else_has_its_name(flat: World, model: mujoco.MjModel) -> None:
    owners = {name.split(".")[0] for name in names(model) if "." in name}
    assert owners == {item.id for item in flat.furniture}


def test_furniture_stands_where_the_world_says(flat: World, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for item in flat.furniture:
        mine = [index for index, name in enumerate(names(model)) if name.startswith(f"{item.id}.")]
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for index in mine:
            center = data.geom_xmat[index].reshape(3, 3) @ model.geom_aabb[index, :3] + data.geom_xpos[index]
            half = np.abs(data.geom_xmat[index].reshape(3, 3)) @ model.geom_aabb[index, 3:]
            low, high = np.minimum(low, center - half), np.maximum(high, center + half)
        c, s = abs(np.cos(item.yaw)), abs(np.sin(item.yaw))
        size = (c * item.depth_m + s * item.width_m, s * item.depth_m + c * item.width_m)
        assert (low + high)[:2] / 2 == pytest.approx((item.x, item.y), abs=0.06), item.id
        assert (high - low)[:2] == pytest.approx(size, abs=0.06), item.id
        assert low[2] == pytest.approx(item.base_m, abs=0.021), item.id


def test_walls_reach_the_ceiling_and_lintels_hang_from_it(make_body: MakeBody) -> None:
    world = generate_world(make_body(height=3.35), 1, 1, settle=False)
    model = mujoco.MjModel.from_xml_string(world_mjcf(world))
    lintels = 0
    for index, wall in enumerate(world.floorplan.walls):
        for name in (f"wall_{index}", f"wall_{index}_left", f"wall_{index}_right"):
            if name in names(model):
                geom = model.geom(name)
                assert geom.pos[2] + geom.size[1] == pytest.approx(3.35)
                assert geom.pos[2] - geom.size[1] == pytest.approx(wall.bottom_m)
                lintels += wall.lintel
    assert lintels > 0


def test_a_ray_through_a_doorway_passes_and_beside_it_hits_the_wall(flat: World, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    doors = [passage for passage in flat.floorplan.passages if passage.kind == "Doorway"]
    assert doors
    for door in doors:
        start, end = np.array(door.start), np.array(door.end)
        along = (end - start) / np.linalg.norm(end - start)
        across = np.array([-along[1], along[0], 0.0])
        middle = (start + end) / 2
        through = first_hit(model, data, [*(middle - 0.5 * across[:2]), 0.3], across)
        assert through > 0.9
        wall = [index for index, name in enumerate(names(model)) if name.startswith("wall_")]
        beside = first_hit(model, data, [*(end + 0.04 * along - 0.5 * across[:2]), 0.3], across)
        assert wall
        assert 0 < beside < 0.5


def first_hit(model: mujoco.MjModel, data: mujoco.MjData, start: list[float], direction: np.ndarray) -> float:
    hit = np.zeros(1, np.int32)
    distance = mujoco.mj_ray(model, data, np.array(start), direction, None, 1, -1, hit, None)
    return np.inf if distance < 0 else distance


def test_all_rays_of_a_lidar_agree_with_single_rays(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    angles = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(360)], axis=1)
    start = np.array([0.0, 0.0, 0.18])
    hits, distances = np.zeros(360, np.int32), np.zeros(360)
    mujoco.mj_multiRay(model, data, start, directions.ravel(), None, 1, -1, hits, distances, None, 360, 50.0)
    single = [first_hit(model, data, list(start), direction) for direction in directions]
    assert distances == pytest.approx(single, abs=1e-9)
    # A closed building: no ray gets out, and nothing stands in the first half metre.
    assert distances.min() >= 0.5
    assert distances.max() < 15


def test_a_robot_attaches_without_clashes(flat: World) -> None:
    world = mujoco.MjSpec.from_string(world_mjcf(flat))
    robot = mujoco.MjSpec.from_string(ROBOT)
    world.worldbody.add_frame(pos=[0, 0, 0]).attach_body(robot.body("base"), "robot/", "")
    model = world.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=500)
    assert model.geom("robot/ground").id > 0
    assert data.body("robot/base").xpos[2] == pytest.approx(0.1, abs=0.01)
    assert not data.warning.number.any()


def test_cameras_see_the_whole_plan(flat: World, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    half_height = np.tan(np.radians(model.camera("top").fovy[0] / 2))
    for name in ("top", "iso"):
        camera = data.cam(name)
        for x, y in flat.floorplan.footprint:
            right, up, back = camera.xmat.reshape(3, 3).T @ (np.array([x, y, 0.0]) - camera.xpos)
            assert back < 0
            assert abs(up / back) <= half_height
            assert abs(right / back) <= half_height * 4 / 3


def test_floors_of_different_material_look_and_grip_differently(make_body: MakeBody) -> None:
    def wish(material: str) -> list[dict[str, object]]:
        target = {"RoomTypes": ["Living", "Kitchen", "Bedroom", "Bathroom"]}
        return [{"Name": "all", "TargetSet": target, "SampleSet": {"MaterialTypes": [material]}}]

    seen: dict[str, tuple[float, ...]] = {}
    grip: dict[str, float] = {}
    for material in ("Carpet", "Concrete", "Floorboards", "Linoleum", "Parquetry", "Tiles"):
        world = generate_world(make_body(flooring=wish(material)), 1, 1, settle=False)
        model = mujoco.MjModel.from_xml_string(world_mjcf(world))
        [name] = [name for name in surfaces(world) if name.startswith("floor_")][:1]
        seen[material] = tuple(model.mat(name).rgba)
        floors = [model.geom(g) for g in range(model.ngeom) if model.geom(g).name.startswith("floor_")]
        assert len({float(floor.friction[0]) for floor in floors}) == 1
        grip[material] = float(floors[0].friction[0])
    assert len(set(seen.values())) == 6
    assert grip["Carpet"] > grip["Concrete"] > grip["Tiles"]


def test_what_slides_stops_sooner_on_carpet_than_on_tiles(make_body: MakeBody) -> None:
    flooring = [
        {"Name": name, "TargetSet": {"RoomTypes": [room]}, "SampleSet": {"MaterialTypes": [name]}}
        for name, room in (("Tiles", "Kitchen"), ("Carpet", "Bedroom"))
    ]
    rooms = (("Living", "Living", 26.0), ("Kitchen", "Kitchen", 14.0), ("Bedroom", "Bedroom", 16.0))
    plan = generate_world(make_body(rooms, flooring=flooring), 1, 1, settle=False).model_copy(update={"furniture": []})
    slid_m = {}
    for room in plan.floorplan.rooms:
        world = mujoco.MjSpec.from_string(world_mjcf(plan))
        puck = world.worldbody.add_body(name="puck", pos=[*room.goal, 0.05])
        puck.add_freejoint()
        puck.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.05], friction=[0.1, 0.005, 0.0001])
        model = world.compile()
        data = mujoco.MjData(model)
        data.qvel[0] = 1.5
        start_m = float(data.qpos[0])
        mujoco.mj_step(model, data, nstep=500)
        slid_m[room.floor_material] = abs(float(data.qpos[0]) - start_m)
        expected_m = 1.5**2 / (2 * FLOORS[room.floor_material].friction * 9.81)
        assert slid_m[room.floor_material] == pytest.approx(expected_m, rel=0.15)
    assert slid_m["Carpet"] < slid_m["Tiles"]


def test_floors_are_flush_and_leave_no_gap_in_doorways(flat: World, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    below = np.array([0.0, 0.0, -1.0])
    geom = np.zeros(1, np.int32)
    for passage in flat.floorplan.passages:
        spots = np.linspace(passage.start, passage.end, 9)[1:-1]
        for x, y in spots:
            depth_m = mujoco.mj_ray(model, data, np.array([x, y, 0.01]), below, None, 1, -1, geom)
            assert depth_m == pytest.approx(0.01, abs=1e-6)
            assert model.geom(int(geom[0])).name.startswith("floor_")


def test_the_model_for_proofs_has_all_that_collides_and_nothing_else(flat: World) -> None:
    bare, whole = (mujoco.MjModel.from_xml_string(text) for text in (proof_mjcf(flat), world_mjcf(flat)))

    def solids(model: mujoco.MjModel) -> dict[str, list[float]]:
        indices = [index for index in range(model.ngeom) if model.geom_contype[index] or model.geom_conaffinity[index]]
        return {model.geom(index).name: [*model.geom_size[index], *model.geom_pos[index]] for index in indices}

    assert solids(bare) == solids(whole)
    assert len(solids(bare)) == bare.ngeom < whole.ngeom / 2
    assert bare.body_mass.tolist() == whole.body_mass.tolist()
