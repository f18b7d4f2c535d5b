import hashlib
import logging
import sys
import tarfile
from pathlib import Path
from typing import Any

import mujoco_menagerie
import pytest
from helpers.robot_stands import CART, CART_MAPPING, Stand, write_robot

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.schemas.runs.policies import POLICY_FACTORY
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.robots.robot_lookup import find_robot

BUILT_IN = "prefect_robomaker.tasks.runtime.applications"


def plan(attribute: str | None, path: Path | None = None) -> ApplicationPlan:
    return ApplicationPlan(role="robot", name="mine", attribute=attribute, path=path)


def test_without_anything_else_it_is_scout(tmp_path: Path) -> None:
    (tmp_path / "nav").mkdir()
    assert find_robot(None, {}).robot.name == "scout"
    assert find_robot(plan(f"{BUILT_IN}.scout.make_agent"), {}).robot.name == "scout"
    assert find_robot(plan("nav.make_agent", tmp_path), {}).robot.name == "scout"
    assert find_robot(plan("no_such_package_here.make_agent"), {}).robot.name == "scout"


def test_the_walker_comes_with_its_application_or_by_its_name() -> None:
    assert find_robot(plan(f"{BUILT_IN}.walker.make_agent"), {}).robot.name == "walker"
    assert find_robot(plan(f"{BUILT_IN}.scout.make_agent"), {"ROBOMAKER_ROBOT": "walker"}).robot.name == "walker"
    assert find_robot(plan(f"{BUILT_IN}.walker.make_agent"), {"ROBOMAKER_ROBOT": "scout"}).robot.name == "scout"


def test_the_innermost_package_with_a_mapping_counts(tmp_path: Path) -> None:
    write_robot(tmp_path, CART_MAPPING | {"name": "outer"})
    inner = tmp_path / "my_cart" / "small"
    inner.mkdir()
    for name in ("robot.yaml", "cart.xml"):
        (inner / name).write_text((tmp_path / "my_cart" / name).read_text().replace("outer", "inner"))
    assert find_robot(plan("my_cart.small.agent.make_agent", tmp_path), {}).robot.name == "inner"
    assert find_robot(plan("my_cart.agent.make_agent", tmp_path), {}).robot.name == "outer"
    assert find_robot(plan(None, tmp_path), {}).robot.name == "scout"
    (inner / "robot.yaml").rename(tmp_path / "robot.yaml")
    (inner / "cart.xml").rename(tmp_path / "cart.xml")
    assert find_robot(plan(None, tmp_path), {}).robot.name == "inner"


def test_the_robot_of_a_policy_is_beside_it_or_that_of_the_application(tmp_path: Path) -> None:
    write_robot(tmp_path, CART_MAPPING)
    (tmp_path / "my_cart").rename(tmp_path / "cart-1.0")
    policy: dict[str, Any] = {"role": "robot", "attribute": POLICY_FACTORY}
    beside = ApplicationPlan(name="mine", path=tmp_path, policy="cart-1.0/walk.onnx", **policy)
    assert find_robot(beside, {}).robot.name == "cart_1_0"
    for name in ("walker", "scout"):
        network = ApplicationPlan(name=name, policy="/opt/robomaker/datasources/nets/walk.onnx", **policy)
        assert find_robot(network, {}).robot.name == name


@pytest.mark.parametrize(
    ("name", "short"), [("My-Cart.v2", "my_cart_v2"), ("3po", "robot_3po"), ("-", "robot"), ("x" * 80, "x" * 60)]
)
def test_a_robot_at_the_top_of_a_bundle_is_called_as_its_application(tmp_path: Path, name: str, short: str) -> None:
    folder = tmp_path / "c496c1a5e07a"
    write_robot(folder, CART_MAPPING)
    (folder / "my_cart").rename(tmp_path / "moved")
    for file in (tmp_path / "moved").iterdir():
        file.rename(folder / file.name)
    application = ApplicationPlan(role="robot", name=name, path=folder)
    assert find_robot(application, {}).robot.name == short
    assert find_robot(application, {"ROBOMAKER_ROBOT": "robot.yaml"}).robot.name == short


def test_it_says_which_robot_it_is_and_why(tmp_path: Path) -> None:
    cart = write_robot(tmp_path, CART_MAPPING)
    assert str(find_robot(cart, {})) == "Robot: my_cart, from my_cart/robot.yaml of the robot application cart."
    assert str(find_robot(cart, {"ROBOMAKER_ROBOT": "walker"})) == "Robot: walker, as ROBOMAKER_ROBOT says (walker)."
    assert str(find_robot(None, {})) == "Robot: scout, since there is no robot application."
    walker = plan(f"{BUILT_IN}.walker.make_agent")
    assert str(find_robot(walker, {})) == "Robot: walker, which the robot application mine drives."
    boxed = find_robot(plan(None), {}, is_container=True)
    assert str(boxed) == "Robot: scout, since the robot application mine is a container."
    assert str(find_robot(plan(None), {})) == "Robot: scout, since the robot application mine has no files here."
    program = plan(None, tmp_path)
    assert str(find_robot(program, {})) == (
        "Robot: scout, since the robot application mine has no robot.yaml in its top folder "
        "(but my_cart/robot.yaml, which ROBOMAKER_ROBOT may name)."
    )
    assert find_robot(program, {"ROBOMAKER_ROBOT": "my_cart/robot.yaml"}).robot.name == "my_cart"
    (tmp_path / "nav").mkdir()
    said = str(find_robot(plan("nav.make_agent", tmp_path), {}))
    assert "has no robot.yaml in nav/, its top folder (but my_cart/robot.yaml, which" in said


def test_a_container_cannot_bring_a_file(tmp_path: Path) -> None:
    assert find_robot(plan(None), {"ROBOMAKER_ROBOT": "walker"}).robot.name == "walker"
    with pytest.raises(
        LaunchError, match=r"mine has no file 'arm.yaml'; files are looked for in bundles .* not in con"
    ):
        find_robot(plan(None), {"ROBOMAKER_ROBOT": "arm.yaml"})


def test_an_installed_package_brings_its_robot_without_being_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_robot(tmp_path, CART_MAPPING)
    (tmp_path / "my_cart" / "__init__.py").write_text("raise RuntimeError('imported too early')")
    monkeypatch.syspath_prepend(tmp_path)
    assert find_robot(plan("my_cart.make_agent"), {}).robot.name == "my_cart"
    program = ApplicationPlan(role="robot", name="mine", package="my_cart")
    assert find_robot(program, {}).robot.name == "my_cart"
    assert "my_cart" not in sys.modules


def test_the_variable_names_a_file_of_the_application(tmp_path: Path) -> None:
    application = write_robot(tmp_path, CART_MAPPING)
    (tmp_path / "my_cart" / "robots").mkdir()
    (tmp_path / "my_cart" / "robot.yaml").rename(tmp_path / "my_cart" / "robots" / "cart-2.yaml")
    (tmp_path / "my_cart" / "cart.xml").rename(tmp_path / "my_cart" / "robots" / "cart.xml")
    assert find_robot(application, {}).robot.name == "scout"
    assert find_robot(application, {"ROBOMAKER_ROBOT": "robots/cart-2.yaml"}).robot.name == "cart_2"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("skout", r"there is no robot 'skout'; did you mean 'scout'\?"),
        ("robots/none.yaml", "the robot application cart has no file 'robots/none.yaml'"),
        ("../other/robot.yaml", "is outside of the robot application"),
        ("/etc/robot.yaml", "is outside of the robot application"),
    ],
)
def test_a_robot_that_is_not_there_is_named(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(LaunchError, match=f"ROBOMAKER_ROBOT: .*{message}") as error:
        find_robot(write_robot(tmp_path, CART_MAPPING), {"ROBOMAKER_ROBOT": name})
    assert error.value.failure_code == "InvalidInput"


@pytest.mark.parametrize("model", ["../cart.xml", "/tmp/cart.xml"])
def test_a_model_outside_of_the_mappings_folder_is_refused(tmp_path: Path, model: str) -> None:
    with pytest.raises(LaunchError, match=r"model: .* has to be a path within the folder"):
        find_robot(write_robot(tmp_path, CART_MAPPING | {"model": model}), {})


# MuJoCo Menagerie


@pytest.fixture
def menagerie(tmp_path: Path) -> dict[str, str]:
    """A checkout as small as can be."""
    folder = tmp_path / "menagerie" / "acme_cart"
    folder.mkdir(parents=True)
    (folder / "cart.xml").write_text(CART)
    (folder / "scene.xml").write_text('<mujoco><include file="cart.xml"/></mujoco>')
    (tmp_path / "menagerie" / "test").mkdir()
    return {"MENAGERIE_ROOT": str(tmp_path / "menagerie"), "ROBOMAKER_ROBOT": "menagerie:acme_cart"}


def test_a_model_of_menagerie_with_a_mapping_drives(menagerie: dict[str, str], tmp_path: Path) -> None:
    write_robot(tmp_path, CART_MAPPING)
    (tmp_path / "my_cart" / "robot.yaml").rename(tmp_path / "menagerie" / "acme_cart" / "robot.yaml")
    robot = find_robot(None, menagerie).robot
    assert robot.name == "acme_cart"
    stand = Stand(robot)
    stand.drive((0.3, 0.0), 1.5)
    assert stand.base.read().linear == pytest.approx(0.3, rel=0.05)


def test_a_bundles_mapping_may_take_its_model_from_menagerie(menagerie: dict[str, str], tmp_path: Path) -> None:
    application = write_robot(tmp_path, CART_MAPPING | {"model": "menagerie:acme_cart/cart.xml"})
    variables = {"MENAGERIE_ROOT": menagerie["MENAGERIE_ROOT"]}
    assert find_robot(application, variables).robot.joints == ("left", "right", "lift")
    wrong = write_robot(tmp_path, CART_MAPPING | {"model": "menagerie:acme_cart/card.xml"})
    with pytest.raises(LaunchError, match=r"acme_cart has no file 'card.xml'; did you mean 'cart.xml'\?"):
        find_robot(wrong, variables)


def test_a_model_of_menagerie_without_a_mapping_stands_as_its_model_says(
    menagerie: dict[str, str], caplog: pytest.LogCaptureFixture
) -> None:
    """Its base moves freely and it has actuators: these are the action, and a policy's matter."""
    with caplog.at_level(logging.INFO):
        robot = find_robot(None, menagerie).robot
    assert robot.name == "acme_cart"
    assert robot.home["lift"] == 0.5, "its keyframe"
    assert robot.spawn_height_m == pytest.approx(0.05)
    assert (
        "the base is 'chassis', 0.05 m over the floor, 0.16 m around, and its actuators are the action" in caplog.text
    )
    stand = Stand(robot)
    stand.drive((3.0, 1.5, 0.0), 1.0)
    assert abs(stand.base.read().linear) > 0.05


def test_a_keyframe_without_a_name_says_how_a_model_of_menagerie_stands(
    menagerie: dict[str, str], tmp_path: Path
) -> None:
    unnamed = '<key qpos="0 0 0.25 1 0 0 0 0 0 0.5"/>'
    model = CART.replace('<key name="up" qpos="0 0 0.05 1 0 0 0 0 0 0.5"/>', unnamed)
    (tmp_path / "menagerie" / "acme_cart" / "cart.xml").write_text(model)
    robot = find_robot(None, menagerie).robot

    assert robot.spawn_height_m == pytest.approx(0.25)
    assert robot.home["lift"] == 0.5


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('<freejoint name="root"/>', "", "its first body, 'chassis', has no free joint"),
        (CART[CART.index("<actuator>") : CART.index("<sensor>")], "", "it has no actuators"),
        ("<geom ", '<geom contype="0" conaffinity="0" ', "it has no shape that collides"),
        ('name="chassis" ', "", "its first body has no name"),
        ('pos="0 0 0.05"', 'pos="0 0 -0.05"', "its first body, 'chassis', is 0.05 m below the floor"),
        ('pos="0 0 0.05"', 'pos="0 0 101"', "spawn.height_m"),
    ],
)
def test_a_model_of_menagerie_that_says_too_little_says_what_to_write(
    menagerie: dict[str, str], tmp_path: Path, old: str, new: str, why: str
) -> None:
    without_keyframe = CART[: CART.index("<keyframe>")] + "</mujoco>"
    (tmp_path / "menagerie" / "acme_cart" / "cart.xml").write_text(without_keyframe.replace(old, new))
    with pytest.raises(LaunchError, match=rf"acme_cart has no robot\.yaml, .*: {why}") as error:
        find_robot(None, menagerie)
    assert "\n" not in str(error.value)
    assert "with `model: menagerie:acme_cart/cart.xml`, base, footprint.radius_m" in str(error.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"MENAGERIE_ROOT": "/no/such/folder"}, "MENAGERIE_ROOT: there is no folder '/no/such/folder'"),
        ({"ROBOMAKER_ROBOT": "menagerie:acme_card"}, r"has no model 'acme_card'; did you mean 'acme_cart'\?"),
        ({"ROBOMAKER_ROBOT": "menagerie:test"}, "has no model 'test'"),
        ({"ROBOMAKER_ROBOT": "menagerie:../acme_cart"}, "has no model"),
    ],
)
def test_what_is_missing_of_menagerie_is_named(
    menagerie: dict[str, str], changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(LaunchError, match=message) as error:
        find_robot(None, menagerie | changes)
    assert error.value.failure_code == "InvalidInput"


# Robots that the package mujoco-menagerie fetches


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """A registry of one robot, acme_cart, its archive behind a URL, and a cache that is empty."""
    source = tmp_path / "source" / "acme_cart"
    write_robot(tmp_path, CART_MAPPING)
    (tmp_path / "my_cart").rename(source.parent.with_name("acme_cart"))
    source.parent.mkdir()
    (tmp_path / "acme_cart").rename(source)
    (tmp_path / "assets").mkdir()
    archive = tmp_path / "assets" / "acme_cart.tar.xz"
    with tarfile.open(archive, "w:xz") as tar:
        tar.add(source, arcname="acme_cart")
    robot = {
        "display_name": "Acme Cart", "category": "mobile", "license": "MIT", "oid": "0" * 40, "asset": archive.name,
        "sha256": hashlib.sha256(archive.read_bytes()).hexdigest(), "download_size": archive.stat().st_size,
        "installed_size": 1, "entry_points": {"cart": {"kind": "robot", "file": "cart.xml"}}, "default_model": "cart",
        "default_scene": None,
    }  # fmt: skip
    found = mujoco_menagerie.Registry.from_dict(
        {"schema": 1, "menagerie_commit": "0" * 40, "robots": {"acme_cart": robot}}
    )
    monkeypatch.setattr(mujoco_menagerie, "bundled", lambda: found)
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("MENAGERIE_BASE_URL", archive.parent.as_uri())
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "cache"))
    return {"MENAGERIE_CACHE_DIR": str(tmp_path / "cache"), "ROBOMAKER_ROBOT": "menagerie:acme_cart"}


def test_a_robot_of_the_registry_drives_once_it_has_been_fetched(registry: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(LaunchError, match=r"is not in .*/cache, and jobs fetch nothing .*prefetch acme_cart` does \("):
        find_robot(None, registry)
    assert not (tmp_path / "cache").exists(), "nothing is fetched before a person asks for it"
    mujoco_menagerie.prefetch(["acme_cart"], progress=None)
    robot = find_robot(None, registry).robot
    assert robot.name == "acme_cart"
    stand = Stand(robot)
    stand.drive((0.3, 0.0), 1.5)
    assert stand.base.read().linear == pytest.approx(0.3, rel=0.05)


def test_a_mapping_of_a_bundle_names_a_model_of_the_registry(registry: dict[str, str], tmp_path: Path) -> None:
    mujoco_menagerie.prefetch(["acme_cart"], progress=None)
    variables = {"MENAGERIE_CACHE_DIR": registry["MENAGERIE_CACHE_DIR"]}
    application = write_robot(tmp_path, CART_MAPPING | {"model": "menagerie:acme_cart/cart.xml"})
    assert find_robot(application, variables).robot.joints == ("left", "right", "lift")
    wrong = write_robot(tmp_path, CART_MAPPING | {"model": "menagerie:acme_cart/card.xml"})
    with pytest.raises(LaunchError, match=r"acme_cart has no file 'card.xml'; did you mean 'cart.xml'\?"):
        find_robot(wrong, variables)
    model = next((tmp_path / "cache" / "models").iterdir())
    (model / "robot.yaml").unlink()
    hold_base(model)
    with pytest.raises(LaunchError, match=r"Write it into a robot application, with `model: menagerie:acme_cart/cart"):
        find_robot(None, registry)


def hold_base(model: Path) -> None:
    """Takes the free joint from a cart, so that no mapping can be derived from it."""
    text = (model / "cart.xml").read_text()
    without_keyframe = text[: text.index("<keyframe>")] + "</mujoco>"
    (model / "cart.xml").write_text(without_keyframe.replace('<freejoint name="root"/>', ""))


def test_a_checkout_comes_before_the_registry(
    registry: dict[str, str], menagerie: dict[str, str], tmp_path: Path
) -> None:
    hold_base(tmp_path / "menagerie" / "acme_cart")
    with pytest.raises(LaunchError, match=r"/menagerie/acme_cart has no robot\.yaml"):
        find_robot(None, registry | menagerie)


def test_an_unknown_robot_of_the_registry_is_named(registry: dict[str, str]) -> None:
    with pytest.raises(LaunchError, match=r"has no model 'acme_card'; did you mean 'acme_cart'\?"):
        find_robot(None, registry | {"ROBOMAKER_ROBOT": "menagerie:acme_card"})


def test_without_the_package_and_a_checkout_it_says_how_to_have_either(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    with pytest.raises(LaunchError, match=r"not installed, and MENAGERIE_ROOT is not set\. .*menagerie.*git clone"):
        find_robot(None, {"ROBOMAKER_ROBOT": "menagerie:acme_cart"})
