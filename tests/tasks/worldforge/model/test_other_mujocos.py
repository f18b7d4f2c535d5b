"""The MJCF of a world is plain: MuJoCo 3.0 to 4.0 read it, each in an environment of its own."""

import json
import re
from pathlib import Path

import pytest
from helpers.client_environments import kept_folder, mujoco_environment, mujoco_warp_environment, run_client

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf

from ..conftest import MakeBody

STEP = """
import json, sys
import mujoco
model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
before = data.xipos.copy()
mujoco.mj_step(model, data, 1000)
drifts_m = abs(data.xipos - before).max(axis=1)
moved = {model.body(int(body)).name: float(drifts_m[body]) for body in (drifts_m > 0.003).nonzero()[0]}
print(json.dumps({"version": mujoco.__version__, "geoms": model.ngeom, "joints": model.njnt, "moved": moved}))
"""

WARP_STEP = """
import json, sys
import mujoco, mujoco_warp
import numpy as np
model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
first = data.xipos.copy()
on_device = mujoco_warp.put_model(model)
batch = mujoco_warp.put_data(model, data, nworld=2, naconmax=2000, njmax=1000)
for _ in range(50):
    mujoco_warp.step(on_device, batch)
mujoco.mj_step(model, data, 50)
places = batch.xipos.numpy()
print("\\n" + json.dumps({
    "finite": bool(np.isfinite(places).all()), "moved_m": float(abs(places - first).max()),
    "apart_m": float(abs(places - data.xipos).max()), "bodies": model.nbody,
}))
"""


def test_it_has_no_word_that_only_newer_mujocos_know(bundles: dict[str, Path], flat: World) -> None:
    for text in [world_mjcf(flat), *((folder / "world.xml").read_text() for folder in bundles.values())]:
        assert "sleep" not in text
        assert not re.search(r"<light[^>]* type=", text)
        # Before 3.1.6, MuJoCo crashes on `texcoord`, and reads it in files.
        assert not re.search(r"<mesh[^>]* (inertia|texcoord)=", text)


@pytest.mark.parametrize(
    "version",
    [
        *(pytest.param(each, marks=pytest.mark.deep) for each in ("3.0.0", "4.0.0")),
        *(pytest.param(each, marks=pytest.mark.endurance) for each in ("3.1.0", "3.1.6", "3.2.7")),
    ],
)
def test_other_mujocos_read_a_world_and_run_it(
    version: str, make_body: MakeBody, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    everywhere = {"RoomNames": ["Living Room", "Kitchen", "Bedroom", "Bath"]}
    dense = {"Name": "all", "TargetSet": everywhere, "DesiredSpatialDensity": "Dense", "LooseObjects": 9}
    body = make_body(furniture=[dense]).model_dump(mode="json", exclude_none=True) | {"Version": "2"}
    world = generate_world(type(make_body()).model_validate(body), 1, 2)
    assert {"Book", "Cup", "Plate"} <= {item.model_type for item in world.furniture}
    write_bundle(world, tmp_path / "world")
    python = mujoco_environment(request.config, version) / "python"
    said = json.loads(run_client([str(python), "-c", STEP, str(tmp_path / "world" / "world.xml")], {}))
    assert world.checks is not None
    assert said["version"] == version
    assert said["joints"] == world.checks.free_bodies
    assert said["geoms"] > world.checks.geoms, "what decorates it is read, too"
    # In 3.0, boxes at some angles are told contacts a metre deep, and jump.
    assert said["moved"] == {} or version < "3.1"


@pytest.mark.endurance
@pytest.mark.timeout(1800)
def test_mujoco_warp_steps_a_world_as_mujoco_does(
    make_body: MakeBody, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """On the CPU, with the limits that the README of exports tells; kernels are compiled in minutes, once."""
    world = generate_world(make_body(), 1, 2)
    write_bundle(world, tmp_path / "world")
    python = mujoco_warp_environment(request.config) / "python"
    kernels = {"WARP_CACHE_PATH": str(kept_folder(request.config, "warp-kernels"))}
    command = [str(python), "-c", WARP_STEP, str(tmp_path / "world" / "world.xml")]
    said = json.loads(run_client(command, kernels, timeout_s=1500).splitlines()[-1])
    assert said["bodies"] > 5
    assert said["finite"]
    assert said["moved_m"] < 0.003
    assert said["apart_m"] < 0.001
