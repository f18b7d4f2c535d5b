"""What decorates worlds: seen, within the renderer's limits, and of no account to physics."""

import re
from typing import Any

import mujoco
import numpy as np
import pytest

from prefect_robomaker.schemas.worlds.appearance import APPEARANCES, relit
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.materials.textures import texture_size_m
from prefect_robomaker.tasks.worldforge.model.mjcf import decorated_mjcf, world_mjcf

from ..conftest import MakeBody

MOST_LIGHTS = 8
SHOWN = np.array([1, 1, 1, 0, 0, 0], np.uint8)
HUNG = ("picture_", "cabinet_", "curtain_", "shelf_", "mirror_", "clock_", "towels_")
MANY_ROOMS = (*((f"Room {number}", "Bedroom", 12.0) for number in range(5)), ("Living", "Living", 30.0))


@pytest.fixture(scope="module")
def decorated(flat: World, tmp_path_factory: pytest.TempPathFactory) -> mujoco.MjModel:
    folder = tmp_path_factory.mktemp("decorated") / "flat"
    write_bundle(flat, folder)
    return mujoco.MjModel.from_xml_path(str(folder / "world.xml"))


def colliding(model: mujoco.MjModel) -> dict[str, tuple[Any, ...]]:
    geoms = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    return {
        model.geom(int(geom)).name: tuple(
            np.asarray(getattr(model, f"geom_{field}")[geom]).tolist()
            for field in ("type", "size", "pos", "quat", "friction", "condim", "contype", "conaffinity", "bodyid")
        )
        for geom in geoms
    }


def test_nothing_that_decorates_a_world_collides(flat: World, decorated: mujoco.MjModel) -> None:
    plain = mujoco.MjModel.from_xml_string(world_mjcf(flat))
    assert decorated.ngeom > plain.ngeom + 40
    assert colliding(decorated) == colliding(plain)
    assert np.array_equal(decorated.body_mass, plain.body_mass)
    places = []
    for model in (plain, decorated):
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=200)
        places.append(data.qpos.copy())
    assert np.array_equal(*places)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_the_renderer_draws_every_light(make_body: MakeBody, appearance: str) -> None:
    for rooms in (MANY_ROOMS, MANY_ROOMS[:2]):
        world = generate_world(make_body(rooms), 1, 1, settle=False)
        model = mujoco.MjModel.from_xml_string(relit(world_mjcf(world), APPEARANCES[appearance]))
        headlight, sun = 1, 1
        assert min(len(rooms), MOST_LIGHTS - 2) + sun <= model.nlight <= MOST_LIGHTS - headlight


def test_the_sun_s_map_of_shadows_lies_over_the_building(decorated: mujoco.MjModel) -> None:
    sun = decorated.light("sun")
    way = decorated.stat.center - sun.pos
    aside = way - (way @ sun.dir) * sun.dir
    assert np.linalg.norm(aside) < 0.01
    assert way @ sun.dir > decorated.stat.extent


def test_one_looks_out_of_windows(flat: World, decorated: mujoco.MjModel) -> None:
    data = mujoco.MjData(decorated)
    mujoco.mj_forward(decorated, data)
    geom = np.zeros(1, np.int32)
    assert flat.floorplan.windows
    for window in flat.floorplan.windows:
        start, end = np.array(window.start), np.array(window.end)
        along = (end - start) / np.linalg.norm(end - start)
        across = np.array([-along[1], along[0], 0.0])
        pane, beside = start + 0.3 * (end - start), start - 0.05 * along
        for spot, height, seen_through in ((pane, 1.4, True), (beside, 1.4, False), (pane, 0.5, False)):
            eye = np.array([*spot, height]) - 0.18 * across
            drawn = mujoco.mj_ray(decorated, data, eye, across, SHOWN, 1, -1, geom)
            assert (drawn < 0 or drawn > 0.36) == seen_through
            # What collides has no hole.
            assert 0 < mujoco.mj_ray(decorated, data, eye, across, None, 1, -1, geom) < 0.36


def test_ceilings_and_lamps_look_down_only(decorated: mujoco.MjModel) -> None:
    trays = 0
    for geom in range(decorated.ngeom):
        if not decorated.geom(geom).name.startswith(("ceiling_", "lamp_")):
            continue
        mesh = int(decorated.geom_dataid[geom])
        first, count = int(decorated.mesh_faceadr[mesh]), int(decorated.mesh_facenum[mesh])
        start = int(decorated.mesh_vertadr[mesh])
        corners = decorated.mesh_vert[start + decorated.mesh_face[first : first + count]].astype(float)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, decorated.geom_quat[geom])
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ turn.reshape(3, 3).T
        assert (normals[:, 2] < 1e-6).all()
        assert decorated.geom_group[geom] == 2
        trays += 1
    assert trays >= 8


def test_pictures_have_their_true_size(decorated: mujoco.MjModel) -> None:
    """MuJoCo lays as many repetitions as `texrepeat` says on two metres."""
    seen = 0
    for material in range(decorated.nmat):
        name = decorated.mat(material).name
        if name.startswith(("floor_", "wall_")) and not name.endswith("_laid") and texture_size_m(name):
            assert 2 / decorated.mat_texrepeat[material] == pytest.approx(texture_size_m(name), rel=1e-3)
            seen += 1
    assert seen >= 3


def test_an_appearance_changes_nothing_but_light(flat: World) -> None:
    day = world_mjcf(flat, textured=True)
    texts = {name: relit(day, lit).splitlines() for name, lit in APPEARANCES.items()}
    lit = ('<texture name="sky"', "<headlight", "<light", '<material name="ceiling"', '<material name="lamp_shade"')
    for name, lines in texts.items():
        differ = [line for line, other in zip(lines, texts["day"], strict=True) if line != other]
        assert all(line.strip().startswith(lit) for line in differ)
        assert (name == "day") == (not differ)
    by_day = relit(day, APPEARANCES["day"])
    assert sorted(re.findall(r'[a-z]+="[^"]*"', by_day)) == sorted(re.findall(r'[a-z]+="[^"]*"', day))


def test_the_same_world_is_decorated_alike(flat: World) -> None:
    again = World.model_validate_json(flat.model_dump_json())
    assert world_mjcf(flat, textured=True) == world_mjcf(again, textured=True)


def box_around(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> tuple[np.ndarray, np.ndarray]:
    turn = data.geom_xmat[geom].reshape(3, 3)
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        # Its frame is that of its inertia, in which its box is larger.
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        points = data.geom_xpos[geom] + model.mesh_vert[first : first + count].astype(float) @ turn.T
        return points.min(axis=0), points.max(axis=0)
    middle = data.geom_xpos[geom] + turn @ model.geom_aabb[geom, :3]
    reach = np.abs(turn) @ model.geom_aabb[geom, 3:]
    return middle - reach, middle + reach


@pytest.mark.parametrize(
    ("version", "seeds"),
    [
        ("1", range(1, 3)),
        ("2", range(1, 3)),
        *(pytest.param(each, range(3, 7), marks=pytest.mark.deep) for each in "12"),
    ],
)
def test_what_hangs_on_walls_is_in_nothing_else(make_body: MakeBody, version: str, seeds: range) -> None:
    kinds: set[str] = set()
    for seed in seeds:
        world = generate_world(make_body().model_copy(update={"Version": version}), seed, seed, settle=False)
        text, meshes = decorated_mjcf(world)
        # Without pictures, whose files are not there.
        plain = re.sub(r'(texture="[^"]*" |<texture .*?/>)', "", text)
        model = mujoco.MjModel.from_xml_string(plain, {path: mesh.encode() for path, mesh in meshes.items()})
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        names = [model.geom(geom).name for geom in range(model.ngeom)]
        boxes = [box_around(model, data, geom) for geom in range(model.ngeom)]
        solid = model.geom_contype > 0
        others = [
            geom for geom, name in enumerate(names) if solid[geom] and "." in name and not name.startswith("door")
        ]
        hung = [geom for geom, name in enumerate(names) if name.startswith(HUNG)]
        kinds |= {names[geom].split("_")[0] for geom in hung}
        for one in hung:
            clash = [names[other] for other in others if overlap_m(boxes[one], boxes[other]) > 0.005]
            assert clash == [], names[one]
        windows = [geom for geom, name in enumerate(names) if name.startswith("window_") and "_frame_" in name]
        for one in hung:
            if not names[one].startswith("curtain_"):
                assert all(overlap_m(boxes[one], boxes[other]) < 0 for other in windows), names[one]
    assert kinds == {name.removesuffix("_") for name in HUNG}


def overlap_m(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> float:
    """How deep two boxes are in each other; negative: apart."""
    return float((np.minimum(one[1], other[1]) - np.maximum(one[0], other[0])).min())


def test_names_are_those_that_every_format_takes(flat: World) -> None:
    text = world_mjcf(flat, textured=True)
    kinds = "wall|window|ceiling|lamp|skirting|curtain|blind|picture|cabinet|rug|thing|book|shelf|mirror|clock|towels"
    names = re.findall(f'<geom name="((?:{kinds})_[^"]*)"', text)
    assert len(names) > 60
    assert len(set(names)) == len(names)
    assert all(re.fullmatch("[A-Za-z0-9_]+", name) for name in names)
