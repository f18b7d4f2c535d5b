"""The client as one copied file: on an old Python, without numpy, and against the simulation's own reading."""

import ast
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from prefect_robomaker.tasks.runtime.agents import agent_client
from prefect_robomaker.tasks.runtime.agents.agent_client import ArraySpec, SimulationError, connect
from prefect_robomaker.tasks.runtime.agents.agent_layout import Layout

FILE = Path(agent_client.__file__)
SPECS = {
    "number": specs.Array((), np.float64),
    "row": specs.BoundedArray((3,), np.float32, -1, 1),
    "block": specs.Array((2, 3, 2), np.int16),
    "flags": specs.Array((2, 2), bool),
    "half": specs.Array((1,), np.float16),
    "none": specs.Array((2, 0, 2), np.uint8),
}
VALUES: dict[str, Any] = {
    "number": 2.5,
    "row": [0.5, -0.5, 1.0],
    "block": [[[1, 2], [3, 4], [5, 6]], [[7, 8], [9, 10], [11, -12]]],
    "flags": [[True, False], [False, True]],
    "half": [0.25],
    "none": [[], []],
}
PROGRAM = """
import json, sys
sys.modules["numpy"] = None
import agent_client
assert agent_client.np is None
layout = agent_client._Layout(json.loads(sys.argv[1]))
data = bytearray(layout.size)
layout.write(json.loads(sys.argv[2]), data)
print(data.hex())
print(json.dumps(layout.read(data)))
for wrong in ({"row": [1, 2]}, {"row": 1.0}, {"block": [[1], [2]]}, {"flags": [[1, 2], [3]]}, {"row": ["x", 1, 2]}):
    try:
        layout.write({**json.loads(sys.argv[2]), **wrong}, data)
        print("taken", wrong)
    except (ValueError, TypeError) as error:
        assert list(wrong)[0] in str(error), error
"""


def python(version: str) -> str:
    """An interpreter, or skips the test."""
    found = shutil.which(version)
    if found is None or subprocess.run([found, "--version"], capture_output=True).returncode != 0:
        pytest.skip(f"there is no {version} here")
    return found


@pytest.mark.parametrize("version", [sys.executable, "python3.8"])
def test_works_as_one_file_without_numpy(tmp_path: Path, version: str) -> None:
    interpreter = python(version)
    shutil.copy(FILE, tmp_path)
    (tmp_path / "program.py").write_text(PROGRAM)
    layout = Layout(SPECS, 8)
    ended = subprocess.run(
        [interpreter, "-E", "-s", "program.py", json.dumps(layout.describe()), json.dumps(VALUES)],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (ended.stderr, ended.returncode) == ("", 0)
    written, *read = ended.stdout.splitlines()
    expected = bytearray(layout.size)
    for field in layout.fields:
        field.view(expected)[...] = np.reshape(VALUES[field.where], field.shape)
    assert written == expected.hex()
    assert [json.loads(line) for line in read] == [VALUES]


def test_is_plain_python_3_8_and_imports_only_the_standard_library() -> None:
    tree = ast.parse(FILE.read_text(), feature_version=(3, 8))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module or "." for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.partition(".")[0] for name in imported} <= sys.stdlib_module_names | {"numpy"}


def test_importing_it_from_the_package_brings_no_simulator() -> None:
    module = agent_client.__name__
    program = f"import sys, {module}; print({{'mujoco', 'prefect', 'pydantic'}} & {{*sys.modules}})"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout == "set()\n"


@pytest.mark.parametrize("value", [[1, 2], 1.0, [[1, 2, 3]], ["x", 1, 2]])
def test_actions_of_another_form_are_refused_before_they_are_sent(value: Any) -> None:
    array = ArraySpec({"path": ["row"], "dtype": "float32", "shape": [3], "offset": 0})
    with pytest.raises(ValueError, match=r"row \(float32\[3\]\)|could not convert"):
        array.write(value, bytearray(12))


def test_no_simulation_listens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(agent_client.SOCKET_VARIABLE, raising=False)
    with pytest.raises(SimulationError, match="ROBOMAKER_AGENT_SOCKET is not set"):
        connect()
    monkeypatch.setenv(agent_client.SOCKET_VARIABLE, str(tmp_path / "none.sock"))
    with pytest.raises(SimulationError, match=r"no simulation listens at .*none\.sock after 0\.1 s"):
        connect(connect_timeout_s=0.1)
