"""Worlds that an earlier generator made stay as they are: shown, driven, exported, and they say who made them.

The bundle is as generator 2.1.0 wrote it. Its `world.xml` names sleep, and a dining chair stands 8 mm inside a leg of
its table, which that generator did not look for.
"""

import shutil
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.paths import TESTS
from helpers.solid_shapes import deep_overlaps

from prefect_robomaker.deployments.cli.inputs.world_lookup import find_world
from prefect_robomaker.deployments.cli.output.world_facts import world_facts
from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.worlds.description import WorldDescription
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import assemble
from prefect_robomaker.tasks.runtime.applications.scout.agent import make_agent
from prefect_robomaker.tasks.runtime.episode.context import SimulationContext
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.worldforge.bundle.bundle import content_hash, read_world
from prefect_robomaker.tasks.worldforge.bundle.proving import prove
from prefect_robomaker.tasks.worldforge.exports.export import write_export_zip
from prefect_robomaker.tasks.worldforge.generator import GENERATOR_VERSION
from prefect_robomaker.tasks.worldforge.proofs.guarantees import MAX_PENETRATION_M, violations

VERSION = "2.1.0"
KEPT = TESTS / "tasks" / "worldforge" / "bundle" / "generators" / VERSION


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """The bundle, where a test may write beside it."""
    return shutil.copytree(KEPT, tmp_path / "earlier")


def test_it_is_read_and_says_which_generator_made_it(earlier: Path) -> None:
    world = read_world(earlier)
    described = WorldDescription.model_validate_json((earlier / "world_description.json").read_bytes())
    assert world.generator_version == described.generatorVersion == VERSION != GENERATOR_VERSION
    assert world.checks is not None
    assert violations(world.checks) == []


def test_show_tells_what_its_generator_did_not_look_for(earlier: Path) -> None:
    facts = world_facts(find_world(str(earlier)))
    assert facts["generator_version"] == VERSION
    (overlaps,) = [proof for proof in facts["proofs"] if proof["name"] == "Penetrations at time 0"]
    assert overlaps["verdict"] == "not measured"
    assert deep_overlaps((earlier / "world.xml").read_text(), MAX_PENETRATION_M)


def test_it_is_proven_anew_as_new_worlds_are(earlier: Path) -> None:
    checks = prove(read_world(earlier), earlier)
    assert checks.settled_share == 1.0
    (broken,) = violations(checks)
    assert broken.startswith("DiningTables_1.leg-front-left and DiningChairs_2.seat overlap by 0.008 m")


def test_scout_drives_through_it(earlier: Path, tmp_path: Path) -> None:
    plan = RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=3, max_duration_s=600.0, world_dir=earlier,
        work_dir=tmp_path, output_dir=tmp_path,
    )  # fmt: skip
    context = SimulationContext(
        plan=plan, rng=np.random.default_rng(3), world=read_world(earlier), world_dir=earlier, data_dir=None,
        output_dir=tmp_path, environment={}, recorder=Recorder(),
    )  # fmt: skip
    before = content_hash(earlier)
    environment = make_environment(context)
    agent = make_agent(context, environment)
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(agent(timestep))
    report = environment.run_result()
    assert report.verdict == "PASS", report.summary
    assert content_hash(earlier) == before


def test_its_loose_objects_sleep_as_it_says(earlier: Path) -> None:
    model = assemble(earlier / "world.xml").model.ptr
    alone = mujoco.MjModel.from_xml_path(str(earlier / "world.xml"))
    init = int(mujoco.mjtSleepPolicy.mjSLEEP_INIT)
    assert model.opt.enableflags == alone.opt.enableflags
    assert np.count_nonzero(model.tree_sleep_policy == init) == np.count_nonzero(alone.tree_sleep_policy == init) > 0


def test_it_is_exported_as_it_is(earlier: Path, tmp_path: Path) -> None:
    write_export_zip({"earlier": earlier}, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        for path in (path for path in KEPT.rglob("*") if path.is_file()):
            (name,) = [
                each for each in archive.namelist() if each.endswith(f"/worlds/earlier/{path.relative_to(KEPT)}")
            ]
            assert archive.read(name) == path.read_bytes()
        (sdf,) = [each for each in archive.namelist() if each.endswith("earlier.world")]
        assert b"DiningTables" in archive.read(sdf)
