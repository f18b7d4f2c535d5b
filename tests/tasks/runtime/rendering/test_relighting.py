"""A camera's picture of a world in another light, whose model stays as it is."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.appearance import APPEARANCES
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world

DRAW = """
import json, sys
import mujoco, numpy as np
from prefect_robomaker.schemas.worlds.appearance import APPEARANCES, relit
from prefect_robomaker.tasks.runtime.rendering.cameras import GlCamera
from prefect_robomaker.tasks.runtime.states.digest import digest_of_model
folder = sys.argv[1]
plain = mujoco.MjModel.from_xml_path(f"{folder}/world.xml")
model = mujoco.MjModel.from_xml_path(f"{folder}/world.xml")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
view = mujoco.MjvCamera()
view.lookat[:], view.distance, view.azimuth, view.elevation = (0, 0, 1.2), 0.01, float(sys.argv[2]), 0
def picture(model, appearance=None):
    camera = GlCamera(model, 160, 120, appearance=appearance)
    try:
        return camera.picture(data, lambda _: view).astype(int)
    finally:
        camera.close()
said = {}
for name in sys.argv[3:]:
    lit = APPEARANCES[name]
    seen = picture(model, lit)
    open(f"{folder}/{name}.xml", "w").write(relit(open(f"{folder}/world.xml").read(), lit))
    file = picture(mujoco.MjModel.from_xml_path(f"{folder}/{name}.xml"))
    differ = float((np.abs(seen - file).max(axis=2) > 12).mean())
    said[name] = {"mean": float(seen.mean()), "differ": differ}
said["same"] = digest_of_model(model) == digest_of_model(plain)
print(json.dumps(said))
"""


@pytest.mark.usefixtures("egl")
@pytest.mark.parametrize("names", [["night"], pytest.param(list(APPEARANCES), marks=pytest.mark.deep)], ids=len)
def test_each_appearance_looks_as_its_file_does_and_the_model_stays(tmp_path: Path, names: list[str]) -> None:
    world = generate_world(WorldTemplateBody.model_validate(BODY), 1, 2)
    write_bundle(world, tmp_path / "world")
    x, y = world.floorplan.windows[0].start
    (tmp_path / "draw.py").write_text(DRAW)
    towards_a_window = str(57.3 * math.atan2(y, x))
    done = subprocess.run(
        [sys.executable, str(tmp_path / "draw.py"), str(tmp_path / "world"), towards_a_window, *names],
        check=True, capture_output=True, text=True, env={**os.environ, "MUJOCO_GL": "egl"},
    )  # fmt: skip
    said = json.loads(done.stdout)
    assert said.pop("same")
    assert 20 < said["night"]["mean"] < 110
    if len(names) > 1:
        assert said["night"]["mean"] < 0.6 * said["evening"]["mean"] < said["evening"]["mean"] < said["day"]["mean"]
        assert said["night"]["mean"] < 0.6 * said["lamps"]["mean"]
    # Skies that renderers work out have other steps than ours.
    assert {name: round(values["differ"], 2) for name, values in said.items() if values["differ"] > 0.05} == {}
