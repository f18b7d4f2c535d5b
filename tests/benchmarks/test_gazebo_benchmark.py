"""Cost of importing Gazebo worlds; prints figures and asserts no time. Times are CPU time of this process."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import time
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.gazebo_house import Box, dae, triangles_of
from PIL import Image

from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world

PIXELS = 1024
"""Side of a picture of a public world."""
PARTS = 12
"""Boxes of a mesh: 144 triangles, as those of a public world's collision meshes and of its simpler visual ones."""
STEPS = 4000


def written_model(folder: Path, name: str, seed: int, *, is_textured: bool) -> None:
    """A model with a mesh of its own; a textured one is drawn with a picture, and with ten times the triangles."""
    dice = np.random.default_rng(seed)

    def mesh(parts: int) -> list[Box]:
        low = dice.uniform(0, 0.4, (parts, 3)) * (1, 1, 3)
        high = low + dice.uniform(0.1, 0.4, (parts, 3)) * (1, 1, 3)
        return [tuple(np.round(each, 4).tolist()) for each in np.hstack([low, high])]  # type: ignore[misc]

    model = folder / "models" / name
    (model / "meshes").mkdir(parents=True)
    solid = [each for box in mesh(PARTS) for each in triangles_of(box)]
    (model / "meshes" / "solid.dae").write_text(dae(solid, 0.01))
    drawn = [each for box in mesh(10 * PARTS) for each in triangles_of(box)] if is_textured else solid
    (model / "meshes" / "drawn.dae").write_text(dae(drawn, 0.01, "look.jpg" if is_textured else ""))
    if is_textured:
        (model / "materials" / "textures").mkdir(parents=True)
        # Pictures of rooms are smooth with some noise: noise alone cannot be compressed.
        ramp = np.add.outer(np.linspace(0, 120, PIXELS), np.linspace(0, 100, PIXELS))[..., None] + dice.uniform(
            0, 30, 3
        )
        grain = dice.normal(0, 3, (PIXELS, PIXELS, 1))
        Image.fromarray(np.clip(ramp + grain, 0, 255).astype(np.uint8)).save(
            model / "materials" / "textures" / "look.jpg", "JPEG"
        )
    uri = f"model://{name}/meshes"
    (model / "model.sdf").write_text(
        f'<sdf version="1.6"><model name="{name}"><static>true</static><link name="l">'
        f'<collision name="c"><geometry><mesh><uri>{uri}/solid.dae</uri></mesh></geometry></collision>'
        f'<visual name="v"><geometry><mesh><uri>{uri}/drawn.dae</uri></mesh></geometry></visual></link></model></sdf>'
    )


def written_world(folder: Path, count: int, *, is_textured: bool) -> Path:
    """A world with as many models in a grid, 1.6 m apart, around a free place."""
    side = int(np.ceil(np.sqrt(count + 9)))
    spots = [(x, y) for x in range(side) for y in range(side) if max(abs(x - side // 2), abs(y - side // 2)) > 1]
    includes = ""
    for number, (x, y) in enumerate(spots[:count]):
        # Every third model is there twice, as in public worlds.
        name = f"thing_{number - 1 if number % 3 == 2 else number}"
        if not (folder / "models" / name).exists():
            written_model(folder, name, number, is_textured=is_textured)
        place = f"{1.6 * (x - side // 2)} {1.6 * (y - side // 2)} 0 0 0 0"
        includes += f"<include><uri>model://{name}</uri><name>t{number}</name><pose>{place}</pose></include>"
    ground = "<include><uri>model://ground_plane</uri></include>"
    path = folder / "some.world"
    path.write_text(f'<sdf version="1.6"><world name="w">{ground}{includes}</world></sdf>')
    return path


@pytest.mark.benchmark
@pytest.mark.parametrize(("count", "is_textured"), [(240, True), (140, False)])
def test_import_of_a_world(count: int, is_textured: bool, tmp_path: Path) -> None:
    path = written_world(tmp_path / "world", count, is_textured=is_textured)
    start = time.process_time()
    world = import_gazebo_world(path, Wishes(start=Start(0.3, 0.3)), tmp_path / "bundle")
    took_s = time.process_time() - start
    size = sum(each.stat().st_size for each in (tmp_path / "bundle").rglob("*") if each.is_file())
    assert world.checks is not None
    assert world.source is not None
    print(
        f"\nimport of {count} models {'with' if is_textured else 'without'} pictures: {took_s:.1f} s of CPU, bundle "
        f"{size / 1e6:.1f} MB, {world.checks.geoms} geoms that collide"
    )


@pytest.mark.benchmark
def test_static_geoms_in_the_world_body_of_one_body_each(tmp_path: Path) -> None:
    """Steps a second with a free cylinder that is pushed about among 800 colliding geoms."""
    path = written_world(tmp_path / "world", 70, is_textured=False)
    import_gazebo_world(path, Wishes(start=Start(0.3, 0.3)), tmp_path / "bundle")
    root = ET.parse(tmp_path / "bundle" / "world.xml").getroot()
    worldbody = root.find("worldbody")
    assert worldbody is not None
    for geom in [each for each in worldbody.findall("geom") if each.get("contype") == "0"]:
        worldbody.remove(geom)
    pusher = ET.SubElement(worldbody, "body", name="pusher", pos="0 0 0.2")
    ET.SubElement(pusher, "freejoint")
    ET.SubElement(pusher, "geom", type="cylinder", size="0.2 0.1", mass="3")
    together = ET.tostring(root, encoding="unicode")
    for number, geom in enumerate(worldbody.findall("geom")):
        worldbody.remove(geom)
        ET.SubElement(worldbody, "body", name=f"own_{number}").append(geom)
    apart = ET.tostring(root, encoding="unicode")
    files = {each.name: each.read_bytes() for each in (tmp_path / "bundle" / "meshes").glob("*")}
    rates: dict[str, list[float]] = {"world body": [], "a body each": []}
    models = {
        "world body": mujoco.MjModel.from_xml_string(together, assets=files),
        "a body each": mujoco.MjModel.from_xml_string(apart, assets=files),
    }
    for _ in range(3):  # in turns: the machine may be busy
        for name, model in models.items():
            rates[name].append(steps_a_second(model))
    best = {name: max(each) for name, each in rates.items()}
    solid = int((models["world body"].geom_contype > 0).sum())
    print(
        f"\n{solid} colliding geoms: {best['world body']:,.0f} steps a second in the world body, "
        f"{best['a body each']:,.0f} with a body each: {best['world body'] / best['a body each']:.2f} times"
    )


def steps_a_second(model: mujoco.MjModel) -> float:
    """Rate of steps by CPU time, while the cylinder is pushed to another side every half second."""
    data = mujoco.MjData(model)
    body = model.body("pusher").id
    start = time.process_time()
    for number in range(STEPS // 250):
        angle = 2.4 * number
        data.xfrc_applied[body, :2] = 25 * np.cos(angle), 25 * np.sin(angle)
        mujoco.mj_step(model, data, 250)
    return STEPS / (time.process_time() - start)
