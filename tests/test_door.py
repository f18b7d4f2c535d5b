"""`prefect_robomaker`: the names that users import, and that importing it costs nothing."""

import ast
import json
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import prefect_robomaker
from prefect_robomaker import operation_flows
from prefect_robomaker.tasks.operations.registry import registry

ROOT = Path(__file__).parents[1]
DOOR = ROOT / "prefect_robomaker"
NAMES = {
    "ConfigurationError",
    "InvalidParameterException",
    "Job",
    "MapTaskRunner",
    "ResourceNotFoundException",
    "ResultRow",
    "RobomakerError",
    "Run",
    "RunInterrupted",
    "RunOptions",
    "RunPipeline",
    "Service",
    "ServiceError",
    "Settings",
    "SpecError",
    "StorageError",
    "World",
    "__version__",
    "call",
    "load_spec",
    "results",
    "robot_env",
    "run",
}


def test_its_names_are_these_and_the_flows_of_all_operations() -> None:
    performed = {entry.perform_name for entry in registry().values() if entry.run_job}

    assert set(prefect_robomaker.__all__) == NAMES | set(registry()) | performed
    assert len(prefect_robomaker.__all__) == len(NAMES) + 57 + 5
    assert set(prefect_robomaker.__all__) <= set(dir(prefect_robomaker))


@pytest.mark.parametrize("name", prefect_robomaker.__all__)
def test_each_name_is_what_it_says(name: str) -> None:
    value = getattr(prefect_robomaker, name)

    if name == "__version__":
        assert value == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    elif name in NAMES - {"RunPipeline"}:
        assert value.__name__ == name
    else:
        assert value.name == name


def test_importing_it_imports_nothing_slow_and_asking_for_a_name_only_what_that_needs() -> None:
    program = """
import json, sys
slow = ("prefect", "mujoco", "dm_control", "pydantic", "numpy", "sqlalchemy", "boto3")
def loaded(): return [name for name in slow if name in sys.modules]
import prefect_robomaker
at_first = loaded(), sorted(name for name in sys.modules if name.startswith("prefect_robomaker."))
prefect_robomaker.Settings, prefect_robomaker.RobomakerError, prefect_robomaker.load_spec, prefect_robomaker.__version__
print(json.dumps([*at_first, loaded()]))
"""
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    at_first, modules, later = json.loads(answer.stdout)

    assert at_first == []
    assert modules == ["prefect_robomaker.operation_flows"]
    assert later == ["pydantic"]


def test_other_names_are_errors() -> None:
    with pytest.raises(AttributeError, match="module 'prefect_robomaker' has no attribute 'CreateWorlds'"):
        _ = prefect_robomaker.CreateWorlds  # pyright: ignore[reportAttributeAccessIssue]


def told_to_type_checkers(module: str) -> dict[str, str]:
    """The names that a module of the package imports for type checkers alone, with the modules that have them."""
    told: dict[str, str] = {}
    for block in ast.parse((DOOR / f"{module}.py").read_text()).body:
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING":
            for each in block.body:
                if isinstance(each, ast.ImportFrom):
                    assert each.level == 1
                    # A name is only passed on by a module that imports it `as` itself.
                    told |= {alias.asname or "": str(each.module) for alias in each.names if alias.asname == alias.name}
    return told


def test_type_checkers_are_told_where_each_name_is() -> None:
    stub = ast.parse((ROOT / "flows" / "operations.pyi").read_text())

    assert set(told_to_type_checkers("__init__")) == NAMES - {"__version__"}
    assert {each.name for each in stub.body if isinstance(each, ast.FunctionDef)} == set(operation_flows.__all__)
    for name, module in told_to_type_checkers("__init__").items():
        given = getattr(import_module(f"prefect_robomaker.{module}"), name)
        assert getattr(prefect_robomaker, name) is given


@pytest.mark.deep
def test_type_checkers_know_its_names(tmp_path: Path) -> None:
    """In the layout that an installed package has, which links make here."""
    package = tmp_path / "prefect_robomaker"
    package.mkdir()
    for each in (*DOOR.glob("*.py"), *(ROOT / layer for layer in ("schemas", "tasks", "flows", "deployments"))):
        package.joinpath(each.name).symlink_to(each)
    names = sorted(set(prefect_robomaker.__all__) - {"RunPipeline"})
    lines = ["import prefect_robomaker", *(f"prefect_robomaker.{name}" for name in names)]
    (tmp_path / "user.py").write_text("\n".join([*lines, "", "prefect_robomaker.DescribeWorld(wrld='arn')", ""]))
    settings = {
        "include": ["user.py", *(f"prefect_robomaker/{path.name}" for path in DOOR.glob("*.py"))],
        "typeCheckingMode": "standard",
        "pythonVersion": "3.11",
    }
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))

    pyright = Path(sys.executable).with_name("pyright")
    command = [pyright, "-p", tmp_path, "--pythonpath", sys.executable, "--outputjson"]
    answer = json.loads(subprocess.run(command, capture_output=True, text=True, check=False).stdout)

    wrong = [each for each in answer["generalDiagnostics"] if each["severity"] == "error"]
    assert {Path(each["file"]).name for each in wrong} == {"user.py"}
    assert {each["range"]["start"]["line"] for each in wrong} == {len(lines) + 1}, wrong
