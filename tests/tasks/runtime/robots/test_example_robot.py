"""The example of a robot in a bundle, and the walker, as jobs drive them: packed, unpacked, run, recorded."""

import math
import re
import shutil
import tarfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import mujoco_menagerie
import numpy as np
import pytest
from helpers.paths import REPOSITORY
from helpers.robot_stands import CART_MAPPING, write_robot
from helpers.small_flat import BODY
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.robots.robot_lookup import find_robot
from prefect_robomaker.tasks.runtime.robots.robot_yaml.shape import ROBOT_MODELS
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.storage import unpack
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

EXAMPLE = REPOSITORY / "deployments" / "specs" / "examples" / "urdf_robot_bundle"
APPLICATIONS = "prefect_robomaker.tasks.runtime.applications"
MakePlan = Callable[..., RunPlan]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("worlds") / "flat"
    write_bundle(generate_world(WorldTemplateBody.model_validate(BODY), *seeds_for(2, 0, 0)), folder)
    return folder


@pytest.fixture
def unpacked(tmp_path: Path) -> Path:
    source = shutil.copytree(EXAMPLE, tmp_path / "source", ignore=shutil.ignore_patterns("__pycache__"))
    with tarfile.open(tmp_path / "rover.tar.gz", "w:gz") as archive:
        archive.add(source / "my_rover", arcname="my_rover")
    unpack(tmp_path / "rover.tar.gz", tmp_path / "unpacked")
    return tmp_path / "unpacked"


def robot(attribute: str, path: Path | None = None, **variables: str) -> ApplicationPlan:
    return ApplicationPlan(
        role="robot", name="robot", attribute=attribute, path=path, environment_variables=variables
    )  # fmt: skip


def messages(plan: RunPlan) -> dict[str, list]:
    """What was recorded, by topic, as an independent reader decodes it."""
    found: dict[str, list] = {}
    with (plan.output_dir / "recording.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(message)
    return found


def carry_out(launcher: Launcher, plan: RunPlan) -> RunResult:
    outcome = launcher.run(plan, lambda: None)
    assert outcome.status == "Completed", outcome.failure_reason
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


def test_the_urdf_robot_of_a_bundle_visits_every_room(
    launcher: Launcher, make_plan: MakePlan, unpacked: Path, world: Path
) -> None:
    application = robot("my_rover.make_agent", unpacked)
    plan = make_plan(simulation_application=None, robot_application=application, world_dir=world, max_duration_s=60.0)
    result = carry_out(launcher, plan)
    assert (result.verdict, result.ended_by) == ("PASS", "environment"), result.summary
    told = (plan.output_dir / "logs" / "stdout.log").read_text()
    assert told == "Robot: my_rover, from my_rover/robot.yaml of the robot application robot.\n"
    recorded = messages(plan)
    joints = recorded["/joint_states"]
    assert list(joints[-1].name) == ["left_wheel_joint", "right_wheel_joint"]
    # As far as the wheels have rolled on average the robot has gone, forwards less backwards.
    rolled_m = 0.06 * np.mean(joints[-1].position)
    assert rolled_m == pytest.approx(result.metrics["distance_m"], rel=0.1)
    odometry = recorded["/odom"][-1]
    assert odometry.child_frame_id == "base_link"
    assert odometry.pose.pose.position.x == pytest.approx(result.path[-1][1], abs=0.05)
    mount = next(each for each in recorded["/tf_static"][0].transforms if each.child_frame_id == "base_scan")
    assert mount.transform.translation.z == pytest.approx(0.23)
    assert len(recorded["/scan"]) > 10
    assert min(min(scan.ranges) for scan in recorded["/scan"]) > 0.15


@pytest.mark.deep
def test_the_walker_visits_every_room(launcher: Launcher, make_plan: MakePlan, world: Path) -> None:
    application = robot(f"{APPLICATIONS}.walker.make_agent")
    plan = make_plan(simulation_application=None, robot_application=application, world_dir=world, max_duration_s=60.0)
    result = carry_out(launcher, plan)
    assert result.verdict == "PASS", result.summary
    joints = messages(plan)["/joint_states"][-1]
    assert len(joints.name) == len(joints.position) == len(joints.velocity) == 12
    assert joints.name[0] == "front_left_abduction"
    assert all(math.isfinite(value) for value in joints.position)


def test_a_robot_that_cannot_be_made_fails_the_job_with_its_file_line_and_member(
    launcher: Launcher, make_plan: MakePlan, unpacked: Path, world: Path
) -> None:
    mapping = unpacked / "my_rover" / "robot.yaml"
    mapping.write_text(mapping.read_text().replace("wheel_radius_m", "wheel_radius"))
    application = robot("my_rover.make_agent", unpacked)
    plan = make_plan(simulation_application=None, robot_application=application, world_dir=world)
    outcome = launcher.run(plan, lambda: None)
    assert (outcome.status, outcome.failure_code) == ("Failed", "InvalidBundleRobotApplication")
    assert outcome.failure_reason is not None
    assert outcome.failure_reason.startswith("Robot application robot has no robot that can be used: robot.yaml")
    assert "drive.wheel_radius: is not known; did you mean 'wheel_radius_m'?" in outcome.failure_reason
    assert "robot.yaml:17:3" in outcome.failure_reason


def test_an_impossible_inertia_fails_the_job_and_the_setting_mends_it_with_a_word_in_its_log(
    launcher: Launcher, make_plan: MakePlan, unpacked: Path, world: Path
) -> None:
    urdf, mapping = unpacked / "my_rover" / "urdf" / "rover.urdf", unpacked / "my_rover" / "robot.yaml"
    text = urdf.read_text()
    inertia = re.search(r"<inertia [^>]*>", text)
    assert inertia is not None
    line = text.count("\n", 0, inertia.start()) + 1
    urdf.write_text(text.replace(inertia[0], '<inertia ixx="1" iyy="1" izz="9" ixy="0" ixz="0" iyz="0"/>', 1))
    application = robot("my_rover.make_agent", unpacked)
    plan = make_plan(simulation_application=None, robot_application=application, world_dir=world, max_duration_s=2.0)
    outcome = launcher.run(plan, lambda: None)
    assert (outcome.status, outcome.failure_code) == ("Failed", "InvalidBundleRobotApplication")
    assert f"rover.urdf:{line}: link 'base_link': its inertia ixx=1 iyy=1 izz=9" in str(outcome.failure_reason)
    mapping.write_text(mapping.read_text() + "\nimpossible_inertia: from_geometry\n")
    plan = make_plan(
        simulation_application=None, robot_application=application, world_dir=world, max_duration_s=2.0, run_id="run-2"
    )
    carry_out(launcher, plan)
    assert f"rover.urdf:{line}: link 'base_link': " in (plan.output_dir / "logs" / "stderr.log").read_text()


@pytest.mark.deep
def test_menagerie_is_where_the_workers_environment_says(
    launcher: Launcher, make_plan: MakePlan, world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "menagerie").mkdir()
    cart = tmp_path / "menagerie" / "acme_cart"
    write_robot(tmp_path, CART_MAPPING)
    (tmp_path / "my_cart").rename(cart)
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path / "menagerie"))
    application = robot(f"{APPLICATIONS}.scout.make_agent", ROBOMAKER_ROBOT="menagerie:acme_cart")
    plan = make_plan(simulation_application=None, robot_application=application, world_dir=world, max_duration_s=60.0)
    result = carry_out(launcher, plan)
    assert result.verdict == "PASS", result.summary
    assert list(messages(plan)["/joint_states"][0].name) == ["left", "right", "lift"]
    application = robot(f"{APPLICATIONS}.scout.make_agent", ROBOMAKER_ROBOT="menagerie:acme_card")
    plan = make_plan(
        simulation_application=None, robot_application=application, world_dir=world, run_id="run-2"
    )  # fmt: skip
    outcome = launcher.run(plan, lambda: None)
    assert (outcome.status, outcome.failure_code) == ("Failed", "InvalidInput")
    assert "has no model 'acme_card'; did you mean 'acme_cart'?" in str(outcome.failure_reason)


@pytest.mark.deep
def test_a_fetched_robot_drives_in_a_job_that_sees_no_other_files_of_its_user(
    launcher: Launcher, make_plan: MakePlan, world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The registry is the package's own; the files that stand for one of its robots are a cart's."""
    write_robot(tmp_path, CART_MAPPING)
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))  # which runs do not see
    monkeypatch.delenv("MENAGERIE_CACHE_DIR", raising=False)
    folder = mujoco_menagerie.Cache().model_path(mujoco_menagerie.get("robot_soccer_kit"))
    folder.parent.mkdir(parents=True)
    (tmp_path / "my_cart").rename(folder)
    (folder / ".complete").write_text("{}")
    application = robot(f"{APPLICATIONS}.scout.make_agent", ROBOMAKER_ROBOT="menagerie:robot_soccer_kit")
    plan = make_plan(simulation_application=None, robot_application=application, world_dir=world, max_duration_s=60.0)
    result = carry_out(launcher, plan)
    assert result.verdict == "PASS", result.summary
    assert "Robot: robot_soccer_kit, as ROBOMAKER_ROBOT says" in (plan.output_dir / "logs" / "stdout.log").read_text()


def test_the_examples_specification_is_right_and_its_model_is_as_the_urdf_says() -> None:
    path = EXAMPLE / "rover.yaml"
    assert load_spec(path.read_text(), str(path)).order
    rover = find_robot(robot("my_rover.make_agent", EXAMPLE), {}).robot
    model = rover.build().compile()
    links = {"base_footprint", "base_link", "left_wheel", "right_wheel", "front_caster", "laser", "imu_link"}
    assert links <= {model.body(index).name for index in range(model.nbody)}
    assert model.body_subtreemass[1] == pytest.approx(5.0 + 2 * 0.4 + 2 * 0.1 + 0.2)
    assert model.actuator_forcerange[0].tolist() == [-1.5, 1.5]


def test_the_mapping_that_the_documentation_shows_is_a_right_one(unpacked: Path) -> None:
    page = (REPOSITORY / "docs" / "robots.md").read_text()
    [shown] = re.findall(r"^```yaml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (unpacked / "my_rover" / "robot.yaml").write_text(shown)
    rover = find_robot(robot("my_rover.make_agent", unpacked), {}).robot
    assert (rover.limits.radius_m, rover.limits.linear_mps) == (0.23, 0.5)
    assert rover.lidar is not None
    assert rover.lidar.height_m == pytest.approx(0.23)


def test_the_agent_that_the_documentation_shows_drives_to_a_room(make_context: Any) -> None:
    page = (REPOSITORY / "docs" / "robots.md").read_text()
    [shown] = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    module: dict[str, Any] = {}
    exec(shown, module)
    context = make_context(environment={"ROOM": "hall"})
    environment = make_environment(context)
    agent = module["make_agent"](context, environment)
    timestep = environment.reset()
    with suppress(StopIteration):
        while True:
            timestep = environment.step(agent(timestep))
            assert not timestep.last(), "the agent ends the run"
    [goal] = [room.goal for room in context.world.floorplan.rooms if room.name == "hall"]
    assert timestep.observation["pose"][:2] == pytest.approx(goal, abs=0.21)


def test_every_member_of_a_mapping_is_in_the_documentation() -> None:
    page = (REPOSITORY / "docs" / "robots.md").read_text()
    for model in ROBOT_MODELS.values():
        schema = model.model_json_schema()
        for shape in (schema, *schema["$defs"].values()):
            missing = [name for name in shape["properties"] if f"`{name}" not in page and f".{name}`" not in page]
            assert not missing, (shape["title"], missing)
