"""What jobs are made of: the same before a run and in it, and another one after any change."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.documents.simulation_jobs import MadeOf, SimulationJobDocument
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning.job_contents import (
    contents_of_request,
    package_content,
    software_versions,
)

SUITE = {"name": "General"}


def request_of(robot: str, **config: Any) -> dict[str, Any]:
    return {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "robotApplications": [{"application": robot, "launchConfig": {}, **config}],
    }


def variables(**values: str) -> dict[str, Any]:
    return {"environmentVariables": values}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installed package with a robot, registered as the application `mine`."""
    folder = tmp_path / "packages" / "my_robot_of_contents"
    (folder / "arms").mkdir(parents=True)
    for file in (folder / "__init__.py", folder / "arms" / "__init__.py"):
        file.write_text("")
    monkeypatch.syspath_prepend(folder.parent)
    return folder


@pytest.fixture
def made_of(service: Service) -> Callable[..., MadeOf]:
    """What a request of a robot application is made of."""

    def tell(robot: str, **config: Any) -> MadeOf:
        return contents_of_request(request_of(robot, **config), service)

    return tell


def register(service: Service, uri: str, name: str = "mine") -> None:
    call("CreateRobotApplication", {"name": name, "environment": {"uri": uri}, "robotSoftwareSuite": SUITE}, service)


def test_a_run_is_made_of_what_its_request_said(swing: Callable[..., dict[str, Any]], service: Service) -> None:
    job = swing(TIME_LIMIT_S="0.5")

    document = SimulationJobDocument.of(service.catalog.get(job["arn"]))
    assert document.made_of == contents_of_request(document.request, service)
    assert document.made_of is not None
    assert (document.made_of.robot or "").startswith("archive ")
    assert document.made_of.once_only is None


def test_a_package_is_all_of_its_files(service: Service, package: Path, made_of: Callable[..., MadeOf]) -> None:
    register(service, "python://my_robot_of_contents.arms")
    before = made_of("mine")
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "byte.pyc").write_bytes(b"code")
    assert made_of("mine") == before

    (package / "model.xml").write_text("<mujoco/>")
    assert made_of("mine").robot != before.robot
    shutil.rmtree(package)
    assert made_of("mine").once_only == "the package of an application is not installed, or cannot be read"


def test_versions_name_what_runs_it() -> None:
    versions = software_versions()
    # The last is an extra, whose version says what its robots are.
    names = {"python", "mujoco", "dm-control", "numpy", "scipy", "prefect-robomaker", "mujoco-menagerie"}
    assert set(versions) == names
    assert versions["mujoco"].startswith("3.")
    assert "(" in versions["prefect-robomaker"], "with a digest of its code"


def test_programs_and_containers_need_not_do_the_same_again(service: Service, made_of: Callable[..., MadeOf]) -> None:
    register(service, "registry.example.com/robot:latest", "boxed")
    assert "is a container" in (made_of("boxed").once_only or "")
    assert "is a program" in (made_of("scout", launchConfig={"command": ["drive"]}).once_only or "")
    assert "is a program" in (made_of("scout", launchConfig={"packageName": "p", "launchFile": "a.py"}).once_only or "")
    assert "has tools" in (made_of("scout", tools=[{"name": "t", "command": "true"}]).once_only or "")
    assert made_of("scout").once_only is None


def test_robots_from_elsewhere_are_not_compared(
    service: Service, package: Path, made_of: Callable[..., MadeOf], monkeypatch: pytest.MonkeyPatch
) -> None:
    register(service, "python://my_robot_of_contents.arms")
    monkeypatch.setenv("MENAGERIE_ROOT", "/menagerie")
    from_menagerie = variables(ROBOMAKER_ROBOT="menagerie:stretch")

    assert made_of("scout").once_only is None
    assert made_of("mine", launchConfig=variables(ROBOMAKER_ROBOT="walker")).once_only is None
    told = "MENAGERIE_ROOT is set, and files from there are not compared"
    assert made_of("mine").once_only == told
    assert made_of("scout", launchConfig=from_menagerie).once_only == told
    monkeypatch.delenv("MENAGERIE_ROOT")
    assert made_of("mine").once_only is None
    assert "its robot is menagerie:stretch" in str(made_of("scout", launchConfig=from_menagerie).once_only)
    launch = variables(ROBOMAKER_ROBOT="menagerie:stretch", MENAGERIE_ROOT="/other")
    assert made_of("scout", launchConfig=launch).once_only == told


def test_robots_that_trials_name_are_not_compared(service: Service) -> None:
    def why(name: str, *values: str) -> str:
        axes = {name: {"kind": "variable", "values": list(values)}}
        return str(contents_of_request({**request_of("scout"), "trials": {"axes": axes}}, service).once_only)

    assert "ROBOMAKER_ROBOT differs from trial to trial" in why("ROBOMAKER_ROBOT", "scout", "menagerie:unitree_go2")
    assert why("SPEED", "1", "2") == "None"


def test_a_policy_that_is_installed_beside_an_archive_is_an_input(
    swing: Callable[..., dict[str, Any]], service: Service, package: Path
) -> None:
    """The archive need not have the module: then the installed one drives, and a changed one drives otherwise."""
    document = SimulationJobDocument.of(service.catalog.get(swing(TIME_LIMIT_S="0.5")["arn"]))
    request = {**document.request, "policy": "my_robot_of_contents.arms:act"}
    before = contents_of_request(request, service)
    assert before == contents_of_request(request, service)

    (package / "arms" / "__init__.py").write_text("def act(observation): return [0.0]")

    now = contents_of_request(request, service)
    assert now.robot == before.robot
    assert now != before
    absent = contents_of_request({**request, "policy": "is_in_the_archive:act"}, service)
    assert absent.once_only is None


def test_siblings_of_a_single_file_are_inputs(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "policies"
    folder.mkdir()
    (folder / "turn_of_contents.py").write_text("from gains_of_contents import GAIN")
    (folder / "gains_of_contents.py").write_text("GAIN = 1")
    monkeypatch.syspath_prepend(folder)
    request = {**request_of("scout"), "policy": "turn_of_contents:act"}
    judged = {**request_of("scout"), "requirements": [
        {"kind": "predicate", "name": "left", "attribute": "turn_of_contents.left"}]}  # fmt: skip
    del request["robotApplications"]
    before = [contents_of_request(each, service) for each in (request, judged)]

    (folder / "notes.txt").write_text("not imported")
    assert [contents_of_request(each, service) for each in (request, judged)] == before
    (folder / "gains_of_contents.py").write_text("GAIN = 2")

    now = [contents_of_request(each, service) for each in (request, judged)]
    assert all(a != b for a, b in zip(now, before, strict=True))
    # Job workers elsewhere need the module itself, and not what happens to lie beside it.
    assert package_content("turn_of_contents").startswith("module ")
    assert package_content("turn_of_contents") != now[0].robot


def test_siblings_that_cannot_be_read_are_no_inputs(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Emacs locks a file by a dangling link, and a folder may have any name."""
    folder = tmp_path / "policies"
    folder.mkdir()
    (folder / "turn_of_locked.py").write_text("")
    monkeypatch.syspath_prepend(folder)
    request = {**request_of("scout"), "policy": "turn_of_locked:act"}
    del request["robotApplications"]
    before = contents_of_request(request, service)

    (folder / ".#turn_of_locked.py").symlink_to("me@laptop.1234:1700000000")
    (folder / "old.py").mkdir()

    assert contents_of_request(request, service) == before


def test_a_single_file_beside_one_that_cannot_be_read_is_not_compared(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "turn_of_secret.py").write_text("")
    (tmp_path / "secret_of_contents.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    read_bytes = Path.read_bytes

    def refused(path: Path) -> bytes:
        if path.name == "secret_of_contents.py":
            raise PermissionError(13, "Permission denied", str(path))
        return read_bytes(path)

    monkeypatch.setattr(Path, "read_bytes", refused)
    request = {**request_of("scout"), "policy": "turn_of_secret:act"}
    del request["robotApplications"]

    told = "the package of an application is not installed, or cannot be read"
    assert contents_of_request(request, service).once_only == told
