"""Environments to train in: gymnasium's own checker passes them, and they have the bits of a job."""

import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers.networks import write_network

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.runs.policies import POLICY_FACTORY
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.runtime.episode.context import RobotProgramError, SimulationContext
from prefect_robomaker.tasks.runtime.policies.policy_agent import PolicyAgent
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.worlds.training import robot_env

MakeContext = Callable[..., SimulationContext]


@pytest.fixture
def world(make_context: MakeContext) -> Path:
    """Folder of the hand-written flat."""
    folder = make_context().world_dir
    assert folder is not None
    return folder


@pytest.mark.parametrize("robot", ["scout", "walker"])
def test_the_checker_of_gymnasium_passes_it(world: Path, robot: str) -> None:
    with warnings.catch_warnings():
        # Advice for training: no limits of positions are known, and actions are metres a second.
        warnings.filterwarnings("ignore", message=r".*(too low|too high|symmetric and normalized|render modes)")
        check_env(robot_env(world, robot))


def test_an_episode_ends_by_its_time_or_by_the_task_and_says_the_verdict(world: Path) -> None:
    env: Any = robot_env(world, time_limit_s=0.5)  # which also takes lists, and says what it does not take
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(2))
    env.reset(seed=1)
    steps = [env.step([0.2, 0.0]) for _ in range(10)]
    assert [step[2:4] for step in steps] == [(False, False)] * 9 + [(False, True)]
    assert steps[-1][4]["verdict"] == "FAIL"
    assert steps[-1][4]["metrics"]["rooms_visited"] == 1
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset first"):
        env.step([0.2, 0.0])
    env.reset(seed=1)
    for action in ([0.2], [np.nan, 0.0], "left"):
        with pytest.raises(RobotProgramError, match=r"^the caller gave"):
            env.step(action)


def test_one_row_of_numbers_is_what_gymnasium_flattens(world: Path) -> None:
    env = robot_env(world)
    observed, _ = env.reset(seed=4)
    row, _ = gymnasium.wrappers.FlattenObservation(env).reset(seed=4)
    assert np.array_equal(row, env._arrays.vector(observed))


@pytest.mark.parametrize("kind", ["onnx", "python"])
def test_a_policy_has_the_same_bits_here_and_in_a_job(
    launcher: Launcher, make_plan: Callable[..., RunPlan], world: Path, tmp_path: Path, kind: str
) -> None:
    bundle = tmp_path / "bundle"
    bundle.mkdir()
    env = robot_env(world, time_limit_s=2.0)
    if kind == "onnx":
        weights = np.random.default_rng(3).normal(0.0, 0.3, (9, 2))
        write_network(bundle / "policy.onnx", {"pose": weights[:3], "imu": weights[3:]})
        policy = "policy.onnx"
    else:
        bundle.joinpath("policy.py").write_text(
            "import numpy as np\n\ndef act(seen):\n    return [0.3, np.sin(10 * seen['time'] + seen['pose'][0])]\n"
        )
        policy = "policy.py:act"
    robot = ApplicationPlan(role="robot", name="mine", attribute=POLICY_FACTORY, path=bundle, policy=policy)
    plan = make_plan(
        simulation_application=ApplicationPlan(
            role="simulation", name="arena",
            attribute="prefect_robomaker.tasks.runtime.applications.indoor_navigation.make_environment",
            environment_variables={"ROBOMAKER_SIM_TIME_LIMIT_S": "2"},
        ),
        robot_application=robot, world_dir=world, seed=6, record=False,
    )  # fmt: skip
    outcome = launcher.run(plan, lambda: None)
    assert outcome.status == "Completed", outcome.failure_reason

    agent: Any = PolicyAgent(policy, bundle, None, env.environment)
    observed, info = env.reset(seed=6)
    is_over = False
    while not is_over:
        observed, _, terminated, truncated, info = env.step(agent._policy(observed))
        is_over = terminated or truncated
    result = RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())
    assert result.metrics["distance_m"] > 0.1
    assert {name: result.metrics[name] for name in info["metrics"]} == info["metrics"]


def test_what_it_cannot_be_made_of_is_told(world: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"^world: /.*has no world\.json; give the folder of a world's bundle"):
        robot_env(tmp_path)
    program = (
        "import sys; sys.modules['gymnasium'] = None\n"
        "import prefect_robomaker\n"
        "try: prefect_robomaker.robot_env('.')\n"
        "except prefect_robomaker.ConfigurationError as error: print(error)\n"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert said.startswith("environments for training need gymnasium, which cannot be imported here")
    assert said.endswith("uv sync --frozen --inexact --extra gymnasium\n")
