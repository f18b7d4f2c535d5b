"""Exported SDF: libsdformat accepts it, gz-physics with DART runs it, and it says the same as the MJCF.

Needs Debian's ignition-tools, libsdformat-dev and libignition-physics-dev; what needs a missing one is skipped and
says so. The last is the package of DART's plugin, too, and of everything that a program with it is built from.
"""

import ctypes.util
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.required_programs import missing, needs

from prefect_robomaker.schemas.worlds.world import Furniture
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world
from prefect_robomaker.tasks.worldforge.exports.export_scene import Thing, make_scene, read_scene
from prefect_robomaker.tasks.worldforge.exports.sdf import model_files
from prefect_robomaker.tasks.worldforge.exports.sdf_worlds import SharedModels, sdf_world
from prefect_robomaker.tasks.worldforge.geometry.boxes import room_rects
from prefect_robomaker.tasks.worldforge.materials.textures import texture_size_m

MODELS = "aws_robomaker_worldforge_shared_models/models"
WORLDS = "aws_robomaker_worldforge_worlds/worlds"
PLUGIN = Path("/usr/lib/x86_64-linux-gnu/ign-physics-5/engine-plugins/libignition-physics5-dartsim-plugin.so")
SETTLE_S = 2.0

Settle = Callable[[str, float], dict[str, dict[str, np.ndarray]]]

LIBSDFORMAT = ctypes.util.find_library("sdformat12")


def worlds_of(exported: Path) -> list[str]:
    return sorted(path.name for path in (exported / WORLDS).iterdir())


@pytest.mark.deep
@needs("ros", shutil.which("ign"), "ign is not installed (Debian's ignition-tools)")
def test_ign_accepts_a_world(exported: Path) -> None:
    name = worlds_of(exported)[0]
    environment = {**os.environ, "SDF_PATH": f"{exported / MODELS}:{exported / WORLDS}"}
    file = exported / WORLDS / name / f"{name}.world"
    done = subprocess.run(["ign", "sdf", "--check", str(file)], env=environment, capture_output=True, text=True)
    assert "Valid." in done.stdout, done.stderr[:2000]
    assert "Warning" not in done.stderr, done.stderr[:2000]


@pytest.mark.slow
@needs("ros", LIBSDFORMAT, "libsdformat12 is not installed (Debian's libsdformat-dev)")
@pytest.mark.deep
def test_libsdformat_accepts_every_sdf_file(exported: Path) -> None:
    files = [str(file) for file in sorted([*exported.rglob("*.sdf"), *exported.rglob("*.world")])]
    assert len(files) > 20
    environment = {**os.environ, "SDF_PATH": f"{exported / MODELS}:{exported / WORLDS}"}
    # What `ign sdf --check` calls, without starting Ruby for each file.
    program = (
        "import ctypes, sys; check = ctypes.CDLL(sys.argv[1]).cmdCheck;"
        "sys.exit(next((file for file in sys.argv[2:] if check(file.encode())), 0))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(LIBSDFORMAT), *files], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[:2000]
    assert done.stdout.count("Valid.") == len(files)
    assert "Warning" not in done.stderr


@pytest.fixture(scope="session")
def settle(exported: Path, tmp_path_factory: pytest.TempPathFactory) -> Settle:
    """Runs a world in gz-physics: each model's place at first and at the end, each joint's position."""
    if not PLUGIN.is_file():
        missing("dart", f"{PLUGIN} is not there (Debian's libignition-physics-dev)")
    if absent := [program for program in ("cmake", "g++", "make") if not shutil.which(program)]:
        missing("dart", f"{' and '.join(absent)} not in PATH, to build a program that uses DART")
    build = tmp_path_factory.mktemp("gz_settle")
    source = Path(__file__).parent / "gz_settle"
    for arguments in (["-S", str(source), "-B", str(build)], ["--build", str(build)]):
        done = subprocess.run(["cmake", *arguments], capture_output=True, text=True)
        assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-2000:]}"

    def run(world: str, seconds: float) -> dict[str, dict[str, np.ndarray]]:
        folders = [str(exported / MODELS), str(exported / WORLDS)]
        file = exported / WORLDS / world / f"{world}.world"
        done = subprocess.run(
            [str(build / "gz_settle"), str(PLUGIN), str(file), str(seconds), *folders], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        found: dict[str, dict[str, np.ndarray]] = {"model": {}, "joint": {}}
        for line in done.stdout.splitlines():
            kind, name, *values = line.split()
            found[kind][name] = np.array([float(value) for value in values])
        return found

    return run


@pytest.mark.deep
def test_everything_settles_in_dart_where_mujoco_has_it(
    settle: Settle, exported: Path, bundles: dict[str, Path]
) -> None:
    for name in worlds_of(exported):
        model = mujoco.MjModel.from_xml_path(str(bundles[name] / "world.xml"))
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        data = mujoco.MjData(model)
        while data.time < SETTLE_S:
            mujoco.mj_step(model, data)
        found = settle(name, SETTLE_S)
        assert len(found["model"]) == 1 + len(read_scene(exported / WORLDS / name).things[1:])
        loose = [model.body(body).name for body in range(1, model.nbody)]
        assert loose
        for body in loose:
            assert np.abs(found["model"][body][3:] - data.body(body).xpos).max() < 0.01, f"{body} of {name}"
        assert all(abs(position[0]) < 0.01 for position in found["joint"].values())
        for fixed in found["model"].keys() - set(loose):
            assert np.array_equal(found["model"][fixed][:3], found["model"][fixed][3:])


def test_pushed_doors_turn_as_far_as_they_can(settle: Settle, exported: Path) -> None:
    name = worlds_of(exported)[0]
    doors = [passage.door for passage in read_world(exported / WORLDS / name).floorplan.passages if passage.door]
    ends = settle(name, -3.0)["joint"]
    assert {door.id for door in doors} == ends.keys()
    for door in doors:
        # Half open at first, then closed, unless something lies in the way.
        assert -door.open_angle_rad - 0.01 < ends[door.id][0] < -0.05
    assert any(abs(ends[door.id][0] + door.open_angle_rad) < 0.01 for door in doors)


def test_equal_furniture_is_stored_once_and_models_of_one_name_are_equal_in_every_export(
    bundles: dict[str, Path],
) -> None:
    together, names, exports = SharedModels(), [], []
    for name in list(bundles)[:2]:  # of one floor plan
        scene, alone = read_scene(bundles[name]), SharedModels()
        used = sdf_world(scene, name, alone).models
        assert sdf_world(scene, name, together).models == used
        kinds = {(item.model_type, item.style, item.width_m, item.depth_m) for item in scene.world.furniture}
        assert len([model for model in used if not model.startswith("door_")]) == len(kinds)
        names.append(set(used))
        exports.append(alone.files)
    assert names[0] & names[1]
    assert len(together.files) < sum(len(each) for each in names)

    first, second = exports
    shared = first.keys() & second.keys()
    assert any("meshes/" in path and "ellipsoid" not in path for name in shared for path in first[name])
    for name in shared:
        assert first[name].keys() == second[name].keys()
        for path, text in first[name].items():
            (words, numbers), (same, others) = split(text), split(second[name][path])
            assert words == same
            # Halves of the fourth digit, in which the MJCF is written, are rounded up or down.
            assert np.allclose(numbers, others, atol=1.5e-4), path


def split(text: str) -> tuple[str, np.ndarray]:
    """The text around the decimal numbers of a file, and these."""
    number = r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])"
    return re.sub(number, "#", text), np.array([float(each) for each in re.findall(number, text)])


def test_a_turned_piece_is_the_same_model(bundles: dict[str, Path]) -> None:
    """All yaws: the MJCF turns a piece by swapping its sizes, or by rotating it."""
    world = read_world(next(iter(bundles.values())))
    beds = [
        Furniture(
            id=f"bed_{number}", model_type="Beds", style="single white", room="Bedroom", x=2.003 * number, y=0.517,
            yaw=yaw, width_m=0.98, depth_m=2.02, height_m=0.9,
        )
        for number, yaw in enumerate((0, np.pi / 2, np.pi, -np.pi / 2))
    ]  # fmt: skip
    turned = world.model_copy(update={"furniture": beds})
    from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf

    scene = make_scene(turned, mujoco.MjModel.from_xml_string(world_mjcf(turned)))
    shared = SharedModels()
    furniture = [thing for thing in scene.things if thing.kind == "furniture"]
    assert len(furniture) == 4
    assert len({shared.add(thing, scene) for thing in furniture}) == 1


def boxes(files: dict[str, str], tag: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Middle and size of a model's boxes that have no turn."""
    found = []
    for element in ET.fromstring(files["model.sdf"]).iter(tag):
        size = element.findtext("geometry/box/size")
        pose = [float(value) for value in element.findtext("pose", "0 0 0 0 0 0").split()]
        if size and not any(pose[3:]):
            found.append((np.array(pose[:3]), np.array([float(value) for value in size.split()])))
    return found


def body_of(scene_things: tuple[Thing, ...], label: str) -> Thing:
    return next(thing for thing in scene_things if thing.kind == "body" and thing.label.startswith(label))


def test_objects_weigh_what_they_weigh_in_mujoco(bundles: dict[str, Path]) -> None:
    scene = read_scene(next(iter(bundles.values())))
    weighed = 0
    for thing in scene.things:
        sdf = ET.fromstring(model_files(thing, "model", scene)["model.sdf"])
        assert sdf.findtext("model/static") == ("false" if thing.kind == "body" else "true")
        if thing.kind != "body":
            assert sdf.find("model/link/inertial") is None
            continue
        mass = float(sdf.findtext("model/link/inertial/mass") or 0)
        assert mass == pytest.approx(scene.model.body(thing.name).mass[0], abs=1e-4)
        moments = [float(sdf.findtext(f"model/link/inertial/inertia/{tag}") or 0) for tag in ("ixx", "iyy", "izz")]
        assert sorted(moments) == pytest.approx(sorted(scene.model.body(thing.name).inertia), rel=1e-3, abs=1e-9)
        weighed += 1
    assert weighed > 3


def test_a_door_is_a_limited_hinge_at_its_corner(bundles: dict[str, Path]) -> None:
    scene = read_scene(next(iter(bundles.values())))
    door = next(passage.door for passage in scene.world.floorplan.passages if passage.door)
    thing = body_of(scene.things, "door")
    files = model_files(thing, "model", scene)
    joint = ET.fromstring(files["model.sdf"]).find("model/joint")
    assert joint is not None
    assert (joint.get("type"), joint.findtext("parent")) == ("revolute", "world")
    limits = [float(joint.findtext(f"axis/limit/{tag}") or 0) for tag in ("lower", "upper")]
    assert limits == pytest.approx([-door.open_angle_rad, door.max_angle_rad - door.open_angle_rad], abs=1e-3)
    leaf = max(boxes(files, "collision"), key=lambda box: box[1].prod())
    assert leaf[1] == pytest.approx([door.leaf_width_m, door.thickness_m, door.leaf_height_m], abs=1e-3)
    assert leaf[0][0] - leaf[1][0] / 2 == pytest.approx(0, abs=1e-3)


def test_the_floor_grips_as_in_mujoco_and_ceilings_face_down(bundles: dict[str, Path]) -> None:
    scene = read_scene(next(iter(bundles.values())))
    building = ET.fromstring(model_files(scene.things[0], "model", scene)["model.sdf"])
    collisions = {element.get("name"): element for element in building.iter("collision")}
    floors = {(name or "").removesuffix("-collision"): element for name, element in collisions.items()}
    floors = {name: element for name, element in floors.items() if name.startswith(("floor_", "ground"))}
    assert len(floors) > len(scene.world.floorplan.rooms)
    for geom, floor in floors.items():
        friction = float(floor.findtext("surface/friction/ode/mu") or 0)
        assert friction == pytest.approx(scene.model.geom(geom).friction[0], abs=1e-3)
    ceilings = [element for element in building.iter("visual") if (element.get("name") or "").startswith("ceiling")]
    assert len(ceilings) >= len(scene.world.floorplan.rooms)
    assert {element.findtext("geometry/plane/normal") for element in ceilings} == {"0 0 -1"}


def obj_lines(file: Path, start: str) -> np.ndarray:
    rows = [line.split()[1:] for line in file.read_text().splitlines() if line.startswith(f"{start} ")]
    return np.array(rows, float)


def test_pictures_lie_in_the_archive_and_have_their_size_on_floors_and_walls(exported: Path) -> None:
    for name in worlds_of(exported):
        folder = exported / WORLDS / name
        seen: dict[str, int] = {"floor": 0, "wall": 0}
        boxes = []
        for visual in ET.parse(folder / "model.sdf").getroot().iter("visual"):
            address = visual.findtext("material/pbr/metal/albedo_map")
            if address is None:
                continue
            mesh = visual.findtext("geometry/mesh/uri") or ""
            assert address.startswith(f"model://{name}/textures/")
            files = [exported / WORLDS / each.removeprefix("model://") for each in (address, mesh)]
            assert all(file.is_file() for file in files), files
            assert visual.findtext("material/diffuse") == "1 1 1 1"
            look = (files[1].parent / files[1].read_text().split()[1]).read_text()
            assert (files[1].parent / look.split()[-1]).resolve() == files[0].resolve()
            spots, places = obj_lines(files[1], "v"), obj_lines(files[1], "vt")
            size_m = texture_size_m(files[0].stem)
            assert size_m is not None
            # Each edge is as long on the picture, laid out in its size, as in the room.
            corners = np.array([line.split()[1:] for line in files[1].read_text().splitlines() if line[:2] == "f "])
            faces, on_picture = (
                np.array([[int(corner.split("/")[part]) - 1 for corner in face] for face in corners]) for part in (0, 1)
            )
            for one, other in ((0, 1), (1, 2)):
                long = np.linalg.norm(spots[faces[:, one]] - spots[faces[:, other]], axis=1)
                laid = np.linalg.norm((places[on_picture[:, one]] - places[on_picture[:, other]]) * size_m, axis=1)
                assert np.abs(long - laid).max() < 2e-3, mesh
            seen[files[0].stem.partition("_")[0]] += 1
            if (visual.get("name") or "").startswith("floor_"):
                middle = np.array((visual.findtext("pose") or "").split()[:2], float)
                boxes.append(np.concatenate([middle + spots[:, :2].min(axis=0), middle + spots[:, :2].max(axis=0)]))
        assert min(seen.values()) >= 1, seen
        rects = np.concatenate([room_rects(room) for room in read_world(folder).floorplan.rooms])
        for box in boxes:
            assert np.abs(rects - box).max(axis=1).min() < 1e-3, "a floor is as large as its room"
