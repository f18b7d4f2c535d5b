import ast
import pkgutil
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml
from helpers.paths import REPOSITORY
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.tags import sys_tags
from packaging.utils import parse_wheel_filename
from pydantic import BaseModel

from prefect_robomaker import schemas
from prefect_robomaker.tasks.operations.registry import registry

TOP = ("prefect_robomaker", "schemas", "tasks", "flows", "deployments")
DOOR = "prefect_robomaker"
COPIED = (
    *(f"{DOOR}/deployments/{name}" for name in ("compose.yaml", "kubernetes/", "machines.env")),
    *(f"{DOOR}/tasks/fleet/agent/{name}" for name in ("Containerfile", "pyproject.toml", "robomaker-agent.service")),
)
"""Files that the documentation has users take from the repository."""


def test_the_wheel_has_every_file_of_the_product(tmp_path: Path) -> None:
    """Modules, and what they read: templates, pictures, models, specifications."""
    source, wheels = tmp_path / "source", tmp_path / "wheels"
    for name in (*TOP, "setup.py", "pyproject.toml", "README.md", "LICENSE"):
        copy = shutil.copytree if (REPOSITORY / name).is_dir() else shutil.copy
        source.mkdir(exist_ok=True)
        copy(REPOSITORY / name, source / name)
    program = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    built = subprocess.run([sys.executable, "-c", program, str(wheels)], cwd=source, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr

    with zipfile.ZipFile(next(wheels.iterdir())) as wheel:
        packed = {name for name in wheel.namelist() if ".dist-info/" not in name}
    tracked = subprocess.run(["git", "ls-files", *TOP], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    files = {
        f"{DOOR}/{name.removeprefix(f'{DOOR}/')}"
        for name in tracked.stdout.splitlines()
        if (REPOSITORY / name).exists()
    }
    assert {name for name in files - packed if not name.startswith(COPIED)} == set()


def test_no_source_file_is_longer_than_600_lines() -> None:
    long = {
        str(path.relative_to(REPOSITORY)): lines
        for top in (*TOP, "tests")
        for path in (REPOSITORY / top).rglob("*.py")
        if (lines := len(path.read_text().splitlines())) > 600
    }

    assert long == {}


def test_every_pydantic_field_has_a_description() -> None:
    """`Field(...)` without `description=` anywhere in the schemas."""
    missing = [
        f"{path.name}:{node.lineno}"
        for path in (REPOSITORY / "schemas").rglob("*.py")
        for statement in ast.walk(ast.parse(path.read_text()))
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.value, ast.Call)
        for node in [statement.value]
        if (name := getattr(node.func, "id", "")) in ("Field", "optional")
        and not (node.args[:1] if name == "optional" else [k for k in node.keywords if k.arg == "description"])
    ]

    assert missing == []


def test_every_model_can_be_built() -> None:
    """Models are built when they are first used: a wrong annotation would fail in a night, and not when imported."""
    for module in pkgutil.walk_packages(schemas.__path__, f"{schemas.__name__}."):
        import_module(module.name)
    models = [each for each in _subclasses(BaseModel) if each.__module__.startswith(f"{schemas.__name__}.")]
    assert len(models) > 300
    for model in models:
        model.model_rebuild()  # raises an error that names the model


def _subclasses(of: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for each in of.__subclasses__():
        yield each
        yield from _subclasses(each)


def test_prefect_yaml_deploys_every_flow() -> None:
    declared = yaml.safe_load((REPOSITORY / "deployments" / "prefect.yaml").read_text())["deployments"]
    entrypoints = {deployment["entrypoint"] for deployment in declared}

    expected = set()
    for name, entry in registry().items():
        expected.add(f"prefect_robomaker.flows.operations.{name}")
        if entry.run_job:
            expected.add(f"prefect_robomaker.flows.operations.{entry.perform_name}")
    assert entrypoints == expected


def test_the_licence_is_that_of_the_distribution() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]

    assert (project["license"], project["license-files"]) == ("Apache-2.0", ["LICENSE"])
    assert "Apache License" in (REPOSITORY / "LICENSE").read_text()


def _size_of_wheel(package: dict[str, Any]) -> int:
    """The size of the file that is downloaded for a locked package here."""
    ranks = {tag: rank for rank, tag in enumerate(sys_tags())}
    wheels = [(parse_wheel_filename(each["url"].rpartition("/")[2])[3], each) for each in package.get("wheels", ())]
    fitting = [(min(ranks[tag] for tag in tags & ranks.keys()), each) for tags, each in wheels if tags & ranks.keys()]
    return (min(fitting, key=lambda pair: pair[0])[1] if fitting else package["sdist"])["size"]


def test_the_readme_says_how_much_its_first_command_downloads() -> None:
    locked = {}
    for package in tomllib.loads((REPOSITORY / "uv.lock").read_text())["package"]:
        if any(Marker(marker).evaluate() for marker in package.get("resolution-markers", ["python_version > '3'"])):
            locked[package["name"]] = package
    needed: set[str] = set()
    waiting = [("prefect-robomaker", "")]
    while waiting:
        name, extra = waiting.pop()
        chosen = locked[name]["optional-dependencies"].get(extra, ()) if extra else locked[name].get("dependencies", ())
        for each in chosen:
            if "marker" in each and not Marker(each["marker"]).evaluate():
                continue
            new = [(each["name"], asked) for asked in ("", *each.get("extra", ()))]
            waiting += new if each["name"] not in needed else new[1:]
            needed.add(each["name"])
    mb = sum(_size_of_wheel(locked[name]) for name in needed) / 1e6
    said = re.search(r"It downloads (\d+) MB once", (REPOSITORY / "README.md").read_text())

    assert said is not None
    uv_mb = 18  # the program that downloads, which is no part of the lock
    assert abs(mb + uv_mb - int(said[1])) < 0.1 * int(said[1])


def test_models_that_are_built_when_used_have_a_pydantic_that_builds_them_under_a_lock() -> None:
    """2.13.5 is the newest without the lock: threads of a server that begin together got errors at random."""
    declared = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["dependencies"]
    (pydantic,) = (each for each in map(Requirement, declared) if each.name == "pydantic")
    assert not pydantic.specifier.contains("2.13.5")
    assert pydantic.specifier.contains("2.14.0")
