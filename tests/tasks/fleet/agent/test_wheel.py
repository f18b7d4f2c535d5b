"""The wheel `robomaker-agent`: pure Python for 3.9, and nothing of this project beside it."""

import ast
import email
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY
from helpers.required_programs import needs

FOLDER = REPOSITORY / "tasks" / "fleet" / "agent"
SOURCES = sorted(FOLDER.rglob("*.py"))
BUILD = "import sys; from setuptools.build_meta import build_wheel; print(build_wheel(sys.argv[1]))"
ALLOWED = {"tuf", "securesystemslib", "__future__"}  # the second is the first's own


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    shutil.copytree(FOLDER, folder / "source", ignore=shutil.ignore_patterns("__pycache__"))
    built = subprocess.run(
        [sys.executable, "-c", BUILD, str(folder)], cwd=folder / "source", capture_output=True, text=True
    )
    assert built.returncode == 0, built.stderr
    return folder / built.stdout.splitlines()[-1]


def test_the_wheel_is_for_every_machine_and_has_all_modules(wheel: Path) -> None:
    assert wheel.name == "robomaker_agent-0.1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as content:
        names = {name for name in content.namelist() if name.startswith("robomaker_agent/")}
        metadata = email.message_from_bytes(content.read("robomaker_agent-0.1.0.dist-info/METADATA"))
        entries = content.read("robomaker_agent-0.1.0.dist-info/entry_points.txt").decode()

    files = [*SOURCES, FOLDER / "robomaker-agent.service"]
    assert names == {f"robomaker_agent/{path.relative_to(FOLDER)}" for path in files}
    assert metadata["Requires-Python"] == ">=3.9"
    assert metadata.get_all("Requires-Dist") == ["tuf<8,>=6"]
    assert "robomaker-agent = robomaker_agent.command_line:main" in entries


def test_the_wheels_agent_imports_nothing_of_this_project(wheel: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel) as content:
        content.extractall(tmp_path)
    modules = [
        ".".join(("robomaker_agent", *path.relative_to(FOLDER).with_suffix("").parts)).removesuffix(".__init__")
        for path in SOURCES
        if path.name != "__main__.py"
    ]
    program = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n" + "\n".join(f"import {name}" for name in modules)
    program += "\nprint([name for name in sys.modules if name.startswith(('prefect', 'pydantic', 'starlette'))])"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path)

    assert (ended.returncode, ended.stdout) == (0, "[]\n"), ended.stderr
    helped = subprocess.run(
        [sys.executable, "-m", "robomaker_agent", "run", "--help"], capture_output=True, text=True, cwd=tmp_path
    )
    assert "--health-command" in helped.stdout


@needs("systemd", shutil.which("systemd-analyze"), "systemd-analyze is not in PATH")
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / "robomaker-agent.service"
    text = (FOLDER / "robomaker-agent.service").read_text()
    unit.write_text(text.replace("/opt/robomaker-agent/bin/robomaker-agent", sys.executable))
    checked = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True)

    assert unit.name not in checked.stderr, checked.stderr


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_every_module_is_right_for_python_3_9(path: Path) -> None:
    tree = ast.parse(path.read_text(), feature_version=(3, 9))
    imported = [node for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))]
    names = {alias.name for node in imported if isinstance(node, ast.Import) for alias in node.names}
    froms = {node.module or "" for node in imported if isinstance(node, ast.ImportFrom) and not node.level}

    assert {name.split(".")[0] for name in names | froms} - ALLOWED <= set(sys.stdlib_module_names)
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.Match)]
    if any(isinstance(node, ast.FunctionDef) for node in ast.walk(tree)):
        assert "__future__" in froms, "so that `X | Y` in annotations is not looked at when it runs"
    assert not [ast.unparse(each) for each in unions_at_run_time(tree)]
    depth = len(path.relative_to(FOLDER).parts)
    assert all(node.level <= depth for node in imported if isinstance(node, ast.ImportFrom)), "stays in its folder"


def unions_at_run_time(tree: ast.Module) -> list[ast.BinOp]:
    """`X | Y` of types outside annotations; of sets and numbers it is fine, and types begin with a capital."""
    annotations = {id(inner) for node in ast.walk(tree) for each in annotated(node) for inner in ast.walk(each)}
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.BinOp)
        and isinstance(node.op, ast.BitOr)
        and id(node) not in annotations
        and any(
            isinstance(side, ast.Name) and (side.id[0].isupper() and not side.id.isupper())
            for side in (node.left, node.right)
        )
    ]


def annotated(node: ast.AST) -> list[ast.expr]:
    if isinstance(node, ast.AnnAssign):
        return [node.annotation]
    if isinstance(node, ast.arg):
        return [node.annotation] if node.annotation else []
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
        return [node.returns] if node.returns else []
    return []
