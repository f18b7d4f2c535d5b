from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from prefect_robomaker.schemas.simulation_run import ApplicationPlan, RunPlan
from prefect_robomaker.tasks.runtime.launcher import Launcher

TROUBLE = Path(__file__).parent / "bundles" / "trouble"


@pytest.fixture(scope="session")
def launcher() -> Iterator[Launcher]:
    with Launcher() as launcher:
        yield launcher


@pytest.fixture
def make_plan(tmp_path: Path) -> Callable[..., RunPlan]:
    """Plans a run of the `trouble` bundle in folders of its own."""

    def make(
        environment: str = "make_environment",
        agent: str = "make_agent",
        variables: dict[str, str] | None = None,
        path: Path = TROUBLE,
        **members,
    ) -> RunPlan:
        folder = tmp_path / members.get("run_id", "run-1")
        plan = {
            "job_id": "sim-7", "job_arn": "arn:aws:robomaker:eu-west-1:111122223333:simulation-job/sim-7",
            "run_id": "run-1", "seed": 5, "max_duration_s": 30.0,
            "work_dir": folder / "work", "output_dir": folder / "out",
            "simulation_application": ApplicationPlan(
                role="simulation", name="arena", attribute=f"trouble.arena.{environment}", path=path,
                environment_variables=variables or {},
            ),
            "robot_application": ApplicationPlan(
                role="robot", name="driver", attribute=f"trouble.agent.{agent}", path=path
            ),
        }  # fmt: skip
        return RunPlan(**(plan | members))

    return make
