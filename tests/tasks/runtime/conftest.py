import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.hand_written_flat import make_context as make_context  # a fixture
from helpers.paths import BUNDLES
from helpers.remote_jobs import Job

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.tasks.runtime.rendering.backends import available_video_backends
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

TROUBLE = BUNDLES / "trouble"


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
            "run_id": "run-1", "seed": 5, "max_duration_s": 120.0,
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


@pytest.fixture
def program(tmp_path: Path) -> Callable[..., ProgramPlan]:
    """Plans a program: a few lines of Python, or another `argv`."""

    def make(code: str, **members: Any) -> ProgramPlan:
        plan = {
            "name": "robot", "role": "robot", "kind": "application", "argv": [sys.executable, "-c", code],
            "folder": tmp_path,
        }  # fmt: skip
        return ProgramPlan(**(plan | members))

    return make


@pytest.fixture
def plan_programs(make_plan: Callable[..., RunPlan]) -> Callable[..., RunPlan]:
    """Plans a run that only has programs."""

    def make(*programs: ProgramPlan, **members: Any) -> RunPlan:
        roles = {program.role for program in programs}
        applications = {
            "robot_application": ApplicationPlan(role="robot", name="driver") if "robot" in roles else None,
            "simulation_application": (
                ApplicationPlan(role="simulation", name="arena") if "simulation" in roles else None
            ),
        }
        return make_plan(**(applications | {"programs": list(programs)} | members))

    return make


@pytest.fixture
def start(launcher: Launcher, make_plan: Callable[..., RunPlan]) -> Iterator[Callable[..., Job]]:
    """Starts a run of the `trouble` bundle whose robot application is a program."""
    jobs = []

    def start(environment: str = "make_environment", robot: dict[str, str] | None = None, **members: Any) -> Job:
        if "." in environment:
            members["simulation_application"] = ApplicationPlan(
                role="simulation", name="arena", attribute=environment, path=TROUBLE
            )
        plan = make_plan(
            environment,
            robot_application=ApplicationPlan(role="robot", name="driver", environment_variables=robot or {}),
            **members,
        )
        jobs.append(Job(launcher, plan))
        return jobs[-1]

    yield start
    for job in jobs:
        job.cancel = True
        job.outcome()
        assert not job.path.exists()


@pytest.fixture
def egl() -> None:
    """Is there for tests that draw with EGL, which not every machine can; rays are tested on all of them."""
    [backend] = [item for item in available_video_backends() if item.name == "egl"]
    if not backend.works:
        pytest.skip(f"egl does not work on this machine: {backend.problem}")
