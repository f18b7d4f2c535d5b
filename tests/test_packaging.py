import ast
import tomllib

import yaml
from helpers.paths import REPOSITORY

from prefect_robomaker.tasks.operations.registry import registry

TOP = ("prefect_robomaker", "schemas", "tasks", "flows", "deployments")
DOOR = "prefect_robomaker"


def test_every_package_folder_is_declared() -> None:
    declared = set(tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])

    found = {
        ".".join((DOOR, *path.parent.relative_to(REPOSITORY).parts)) if top != DOOR else DOOR
        for top in TOP
        for path in (REPOSITORY / top).rglob("__init__.py")
        if REPOSITORY / "deployments" / "specs" not in path.parents
    }

    assert declared == found


def test_no_source_file_is_longer_than_500_lines() -> None:
    long = {
        str(path.relative_to(REPOSITORY)): lines
        for top in (*TOP, "tests")
        for path in (REPOSITORY / top).rglob("*.py")
        if (lines := len(path.read_text().splitlines())) > 500
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
        if getattr(node.func, "id", "") == "Field" and not any(k.arg == "description" for k in node.keywords)
    ]

    assert missing == []


def test_prefect_yaml_deploys_every_flow() -> None:
    declared = yaml.safe_load((REPOSITORY / "deployments" / "prefect.yaml").read_text())["deployments"]
    entrypoints = {deployment["entrypoint"] for deployment in declared}

    expected = set()
    for name, entry in registry().items():
        expected.add(f"prefect_robomaker.flows.{entry.resource}.{name}")
        if entry.run_job:
            expected.add(f"prefect_robomaker.flows.{entry.resource}.{entry.perform_name}")
    assert entrypoints == expected


def test_the_licence_is_that_of_the_distribution() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]

    assert (project["license"], project["license-files"]) == ("Apache-2.0", ["LICENSE"])
    assert "Apache License" in (REPOSITORY / "LICENSE").read_text()
