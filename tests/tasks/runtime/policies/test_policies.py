"""Policies: what they are given and asked for, and one sentence about each that cannot be used."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs
from helpers.networks import write_network
from helpers.stop_flags import StopFlag
from onnx import TensorProto

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.schemas.runs.policies import POLICY_FACTORY
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.episode.context import RobotProgramError
from prefect_robomaker.tasks.runtime.episode.loading import LoadError
from prefect_robomaker.tasks.runtime.episode.progress import Progress
from prefect_robomaker.tasks.runtime.policies.policy_agent import PolicyAgent
from prefect_robomaker.tasks.runtime.process.attempt import report_of
from prefect_robomaker.tasks.runtime.process.trial_runs import TrialStage

SPEC = {
    "speed": specs.Array((), np.float64),
    "lidar": {"near": specs.BoundedArray((3,), np.float32, 0.0, np.inf), "hit": specs.Array((2,), np.bool_)},
    "label": specs.StringArray(()),
}
OBSERVATION = {
    "speed": np.array(0.5),
    "lidar": {"near": np.array([1, 2, 3], np.float32), "hit": np.array([True, False])},
    "label": np.array("hall"),
}
IN_A_ROW = [1, 0, 1, 2, 3, 0.5]
"""`lidar/hit`, `lidar/near`, `speed`."""
ACTION = specs.BoundedArray((2,), np.float64, -1.0, 1.0, name="wheels: left, right")
SUM = np.ones((6, 2))

Make = Callable[..., PolicyAgent]


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Makes the agent of a policy whose files are in a folder."""
    monkeypatch.setattr(sys, "path", list(sys.path))

    def make(
        policy: str, action: Any = ACTION, folder: Path | None = tmp_path, root: Path | None = None
    ) -> PolicyAgent:
        environment: Any = SimpleNamespace(observation_spec=lambda: SPEC, action_spec=lambda: action)
        return PolicyAgent(policy, folder, root, environment)

    return make


def act(agent: PolicyAgent) -> list[float]:
    """The action of the observation above."""
    action = agent(dm_env.transition(0.0, OBSERVATION))
    assert action.dtype == ACTION.dtype
    return action.tolist()


def test_a_function_of_a_file_gets_arrays_by_name(make: Make, tmp_path: Path) -> None:
    tmp_path.joinpath("beside.py").write_text("HALF = 0.5\n")
    tmp_path.joinpath("walk.py").write_text(
        "from beside import HALF\n\n"
        "def act(seen):\n"
        "    assert list(seen) == ['lidar/hit', 'lidar/near', 'speed'], list(seen)\n"
        "    return [seen['lidar/near'][1] * HALF, seen['speed']]\n"
    )
    assert act(make("walk.py:act")) == [1.0, 0.5]


def test_a_class_of_a_package_is_made_once_and_says_what_it_remembers(make: Make, tmp_path: Path) -> None:
    package = tmp_path / "remembering"
    package.mkdir()
    package.joinpath("__init__.py").touch()
    package.joinpath("counting.py").write_text(
        "class Counting:\n"
        "    def __init__(self): self.steps = 0\n"
        "    def __call__(self, seen): self.steps += 1; return [self.steps, 0]\n"
        "    def state(self): return self.steps\n"
        "    def restore(self, state): self.steps = state\n"
    )
    agent = make("remembering.counting:Counting")
    assert [act(agent), act(agent)] == [[1.0, 0.0], [2.0, 0.0]]
    agent.restore(7)
    assert (act(agent), agent.state()) == ([8.0, 0.0], 8)


@pytest.mark.parametrize("file", ["turn-away.py", "walk.v2.py"])
def test_files_of_any_name_hold_policies(make: Make, tmp_path: Path, file: str) -> None:
    (tmp_path / file).write_text("act = lambda seen: [0.5, 1]\n")
    assert act(make(f"{file}:act")) == [0.5, 1.0]


@pytest.mark.parametrize(
    ("dtype", "action"), [(np.int8, "[1, 300]"), (np.uint8, "[-1, 0]"), (np.float32, "[1e300, 0]")]
)
def test_an_action_is_not_turned_into_another_one(make: Make, tmp_path: Path, dtype: Any, action: str) -> None:
    (tmp_path / "walk.py").write_text(f"act = lambda seen: {action}\n")
    agent = make("walk.py:act", action=specs.Array((2,), dtype))
    with pytest.raises(RobotProgramError, match=rf"an action has numbers of type {np.dtype(dtype)}"):
        agent(dm_env.transition(0.0, OBSERVATION))


def test_what_was_observed_is_not_turned_into_something_else(make: Make, tmp_path: Path) -> None:
    write_network(tmp_path / "half.onnx", {"obs": SUM}, kind=TensorProto.FLOAT16)
    agent = make("half.onnx")
    assert act(agent) == [sum(IN_A_ROW)] * 2
    seen = {**OBSERVATION, "speed": np.array(7e4)}
    with pytest.raises(RobotProgramError, match=r"its input 'obs' has type float16, which cannot hold .*up to 70000"):
        agent(dm_env.transition(0.0, seen))


def test_a_network_gets_all_numbers_in_a_row_or_arrays_by_name(make: Make, tmp_path: Path) -> None:
    write_network(tmp_path / "row.onnx", {"obs": SUM}, output="mean")
    assert act(make("row.onnx")) == [sum(IN_A_ROW)] * 2
    named = {"lidar/near": [[1, 0], [0, 1], [0, 0]], "lidar/hit": [[0.5, 0], [0, 0]]}
    write_network(tmp_path / "named.onnx", named, shapes={"lidar/near": [1, 3]}, more_outputs=["value"])
    assert act(make("named.onnx")) == [1.5, 2.0]
    write_network(tmp_path / "double.onnx", {"obs": SUM}, shapes={"obs": [6]}, kind=TensorProto.DOUBLE)
    assert act(make("double.onnx")) == [sum(IN_A_ROW)] * 2


def test_a_file_of_a_data_source_is_below_the_root_of_the_job(make: Make, tmp_path: Path) -> None:
    place = tmp_path / "root" / "opt/robomaker/datasources/nets"
    place.mkdir(parents=True)
    write_network(place / "row.onnx", {"obs": SUM})
    path = "/opt/robomaker/datasources/nets/row.onnx"
    assert act(make(path, folder=None, root=tmp_path / "root")) == [sum(IN_A_ROW)] * 2
    (place / "out.onnx").symlink_to(write_network(tmp_path / "outside.onnx", {"obs": SUM}))
    with pytest.raises(LoadError, match="data sources have no file"):
        make(path.replace("row", "out"), folder=None, root=tmp_path / "root")


def test_a_file_with_an_application_that_has_no_archive_is_told_where_files_may_be(make: Make) -> None:
    with pytest.raises(LoadError, match=r"policy nets/row\.onnx: files are read from archives .* installed package"):
        make("nets/row.onnx", folder=None)


@pytest.mark.parametrize(
    ("weights", "members", "said"),
    [
        ({"obs": np.ones((5, 2))}, {"shapes": {"obs": [1, 5]}},
         r"its input 'obs' has shape \[1, 5\], and the observation has 6 numbers: lidar/hit 2, lidar/near 3, speed 1"),
        ({"obs": np.ones((6, 3))}, {},
         r"its output 'action' has shape \[any, 3\], and an action has 2 numbers: wheels: left, right"),
        ({"obs": SUM}, {"kind": TensorProto.INT64}, r"its input 'obs' is tensor\(int64\); all numbers in a row need"),
        ({"lidar/near": np.ones((3, 2)), "obs": SUM}, {}, "'obs' is none of the observation's: lidar/hit 2"),
        ({"lidar/near": np.ones((2, 2))}, {"shapes": {"lidar/near": [1, 2]}},
         r"'lidar/near' has shape \[1, 2\], and the observation has \[3\]"),
        ({"lidar/near": np.ones((3, 2))}, {"kind": TensorProto.INT32},
         r"'lidar/near' is tensor\(int32\), and the observation has float32"),
        ({"obs": SUM}, {"output": "mean", "more_outputs": ["value"]},
         "its outputs are 'mean', 'value'; name the one that is the action 'action'"),
    ],
)  # fmt: skip
def test_a_network_that_does_not_fit_says_what_would(
    make: Make, tmp_path: Path, weights: dict[str, Any], members: dict[str, Any], said: str
) -> None:
    write_network(tmp_path / "bad.onnx", weights, **members)
    with pytest.raises(LoadError, match=f"^policy bad.onnx does not fit the environment: .*{said}") as caught:
        make("bad.onnx")
    assert "\n" not in str(caught.value)


def test_what_cannot_be_loaded_is_told_in_one_sentence(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "text.onnx").write_text("no network")
    (tmp_path / "broken.py").write_text("1 / 0")
    (tmp_path / "fine.py").write_text("act = lambda seen: None\nclass Idle: pass\n")
    for policy, said in {
        "text.onnx": "policy text.onnx is no network that onnxruntime can read",
        "gone.onnx": r"policy gone.onnx: the robot application has no file gone.onnx; .* has text.onnx",
        "broken.py:act": "policy broken.py:act: running broken.py failed: ZeroDivisionError",
        "fine.py:walk": r"policy fine.py:walk: fine.py has no walk \(needed for walk\); it has Idle, act",
        "fine.py:Idle": "an instance of it cannot be called",
        "fines:act": r"policy fines:act: the bundle has no package fines .*did you mean fine",
    }.items():
        with pytest.raises(LoadError, match=said) as caught:
            make(policy)
        assert "\n" not in str(caught.value)
    with pytest.raises(
        LoadError, match=r"no installed package no_such_here .*; a module of your own is .*PYTHONPATH says"
    ):
        make("no_such_here:act", folder=None)
    with pytest.raises(LoadError, match="the environment's action is not one array"):
        make("fine.py:act", action={"left": ACTION, "right": ACTION})
    write_network(tmp_path / "fine.onnx", {"obs": SUM})
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(LoadError, match=r"needs onnxruntime, .*uv sync --frozen --inexact --extra onnx$"):
        make("fine.onnx")


@pytest.mark.parametrize(
    ("action", "said"),
    [
        ("None", "gave None; an action has 2 numbers: wheels: left, right"),
        ("[1, 2, 3]", r"gave \[1, 2, 3\]; an action has 2 numbers"),
        ("[[1], [2, 3]]", "an action has 2 numbers"),
        ("'left'", "gave 'left'; an action"),
        ("[1, float('nan')]", r"gave \[1, nan\], which is not finite"),
        ("[float('inf'), 0]", "which is not finite"),
    ],
)
def test_what_is_no_action_is_the_policys_fault(make: Make, tmp_path: Path, action: str, said: str) -> None:
    (tmp_path / "walk.py").write_text(f"act = lambda seen: {action}\n")
    with pytest.raises(RobotProgramError, match=f"^policy walk.py:act gave .*{said.removeprefix('gave ')}"):
        act(make("walk.py:act"))


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        (
            [1, np.inf, 2],
            "infinite numbers in lidar/near are normal, and may be the cause: a policy has to limit those",
        ),
        ([1, np.inf, np.nan], "it observed NaN in lidar/near, which may be the cause$"),
    ],
)
def test_what_may_have_made_an_action_infinite_is_named(
    make: Make, tmp_path: Path, numbers: list[float], said: str
) -> None:
    write_network(tmp_path / "row.onnx", {"obs": SUM})
    seen = {**OBSERVATION, "lidar": {**OBSERVATION["lidar"], "near": np.array(numbers, np.float32)}}
    with pytest.raises(RobotProgramError, match=rf"^policy row.onnx gave .*, which is not finite; {said}"):
        make("row.onnx")(dm_env.transition(0.0, seen))


def test_the_reason_says_in_which_step_time_and_trial_an_action_was_not_finite(
    make_context: Any, tmp_path: Path
) -> None:
    (tmp_path / "brain.py").write_text("act = lambda seen: [0.3, float('nan') if seen['time'] > 0.09 else 0]\n")
    robot = ApplicationPlan(
        role="robot",
        name="brain",
        attribute=POLICY_FACTORY,
        policy="brain.py:act",
        path=tmp_path,
    )
    trials = Trials.model_validate({"seeds": 2})
    changes = {"trials": trials, "seed": 4, "record": False, "robot_application": robot}
    plan = make_context().plan.model_copy(update=changes)
    progress = Progress()
    with pytest.raises(RobotProgramError, match=r"gave \[0\.3, nan\], which is not finite") as caught:
        TrialStage(plan, progress, StopFlag()).play(trials.trial(1, plan.seed))
    told = report_of(caught.value, progress)["error"]
    assert told == f"{caught.value}, in step 3, at 0.100 s simulated, in trial 1 (seed 5)"


def test_networks_are_computed_without_telling_their_makers(make: Make, tmp_path: Path) -> None:
    """The wheels of onnxruntime keep a number of the machine in the cache, and send it with what is computed."""
    write_network(tmp_path / "row.onnx", {"obs": SUM})
    program = (
        "from types import SimpleNamespace\n"
        "from pathlib import Path\n"
        "import numpy as np, sys\n"
        "from dm_env import specs\n"
        "from prefect_robomaker.tasks.runtime.policies.policy_agent import PolicyAgent\n"
        "seen, action = specs.Array((6,), float), specs.Array((2,), float)\n"
        "PolicyAgent('row.onnx', Path(sys.argv[1]), None,"
        " SimpleNamespace(observation_spec=lambda: seen, action_spec=lambda: action))\n"
    )
    home = tmp_path / "home"
    home.mkdir()
    environ = {name: value for name, value in os.environ.items() if not name.startswith(("ORT_", "XDG_"))}
    words = [sys.executable, "-c", program, str(tmp_path)]
    ran = subprocess.run(words, env={**environ, "HOME": str(home)}, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert [path.name for path in home.rglob("*")] == []


def test_a_network_that_gives_no_number_is_the_policys_fault(make: Make, tmp_path: Path) -> None:
    write_network(tmp_path / "nan.onnx", {"obs": SUM * np.nan})
    with pytest.raises(RobotProgramError, match=r"^policy nan.onnx gave .*nan.*, which is not finite$"):
        act(make("nan.onnx"))
