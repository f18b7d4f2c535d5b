"""Containers of runs that are over: all of them go, and no others; what cannot be removed is not forgotten."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.application_calls import Applications
from helpers.fake_engine import FakeEngine
from helpers.processes import wait_for

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.containers.cleanup import has_containers, remove_containers, remove_run
from prefect_robomaker.tasks.simulations.containers.plans import plan_container
from prefect_robomaker.tasks.simulations.environment.run_environment import RunEnvironment, run_sandbox

PlanIn = Callable[[Path], ProgramPlan]


@pytest.fixture
def plan_in(fake: FakeEngine, service: Service, environ: dict[str, str]) -> PlanIn:
    """Plans one and the same run in a folder: its robot is a container."""
    arn = Applications.of("Robot", service).create("sleeper", environment={"uri": "sleeper"})["arn"]
    application = service.catalog.get(arn)
    variables = {"TOKEN": "secret", "TEXT": "one\ntwo", "QUOTED": ' "a" $B # c '}

    def plan(folder: Path) -> ProgramPlan:
        for name in ("work", "output"):
            (folder / name).mkdir(parents=True)
        run = RunPlan(
            job_id="sim-1",
            job_arn="arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1",
            run_id="2026",
            seed=1,
            work_dir=folder / "work",
            output_dir=folder / "output",
            max_duration_s=60,
            environment={"ROS_DOMAIN_ID": "7"},
        )
        run_environment = RunEnvironment(run, folder, run_sandbox(folder).create(), (), service, environ=environ)
        launch = {"launchConfig": {"environmentVariables": variables}}
        return plan_container(
            "robot", application, "sleeper", launch, run_environment, drives=True, variables={}, bridge=None
        )[0]

    return plan


@pytest.fixture
def environ(fake: FakeEngine) -> dict[str, str]:
    return {"PATH": "/usr/bin:/bin", "ROBOMAKER_CONTAINER_ENGINE": str(fake.program)}


def test_who_runs_a_run_again_leaves_the_container_of_the_first_alone(
    fake: FakeEngine, plan_in: PlanIn, environ: dict[str, str], tmp_path: Path
) -> None:
    program = plan_in(tmp_path / "first")
    [first] = fake.containers()
    running = subprocess.Popen(program.argv, env=environ)
    try:
        wait_for(lambda: fake.runs(first), "the first container to run")
        plan_in(tmp_path / "again")
        assert len(fake.containers()) == 2

        assert remove_containers(tmp_path / "again", environ) == []

        assert fake.containers() == [first]
        assert running.poll() is None
    finally:
        remove_containers(tmp_path / "first", environ)
        running.wait(200)
    assert fake.containers() == []


@pytest.mark.parametrize("kind", ["", pytest.param("-image", marks=pytest.mark.deep)])
def test_a_container_that_was_there_before_is_not_the_run_s_to_remove(
    fake: FakeEngine, plan_in: PlanIn, environ: dict[str, str], tmp_path: Path, kind: str
) -> None:
    plan_in(tmp_path / "run")
    [name] = fake.containers()
    assert remove_containers(tmp_path / "run", environ) == []
    subprocess.run([fake.program, "create", "--name", f"{name}{kind}", "sleeper"], check=True)
    (tmp_path / "run").rename(tmp_path / "before")

    with pytest.raises(LaunchError, match="already in use"):
        plan_in(tmp_path / "run")
    remove_containers(tmp_path / "run", environ)

    assert fake.containers() == [f"{name}{kind}"]


def test_a_container_that_cannot_be_removed_is_not_forgotten(
    fake: FakeEngine, plan_in: PlanIn, environ: dict[str, str], tmp_path: Path
) -> None:
    run = tmp_path / "run"
    plan_in(run)
    [name] = fake.containers()

    fake.lose_daemon()
    said = remove_containers(run, environ)
    assert any(f"{name} cannot be removed: Cannot connect to the Docker daemon" in line for line in said)
    assert has_containers(run)
    assert not remove_run(run)
    assert run.is_dir()

    fake.find_daemon()
    assert remove_containers(run, environ) == []
    assert fake.containers() == []
    assert remove_run(run)
    assert not run.exists()


def test_variables_are_in_a_file_for_the_user_alone_that_is_gone_afterwards(
    fake: FakeEngine, plan_in: PlanIn, environ: dict[str, str], tmp_path: Path
) -> None:
    """Everybody on a machine may read command lines; only what no such file can hold is in one."""
    kept = tmp_path / "kept"
    fake.program.write_text(
        fake.program.read_text().replace(
            'if option == "--env-file":',
            f'if option == "--env-file":\n            os.link(value, {str(kept)!r})',
        )
    )

    plan_in(tmp_path / "run")

    [argv] = [call for call in fake.calls() if "--env-file" in call]
    assert not any("secret" in word for word in argv)
    assert argv[argv.index("-e") + 1] == "TEXT=one\ntwo"
    assert kept.stat().st_mode & 0o777 == 0o600
    assert {"TOKEN=secret", 'QUOTED= "a" $B # c '} < set(kept.read_text().splitlines())
    assert not os.path.lexists(argv[argv.index("--env-file") + 1])
    remove_containers(tmp_path / "run", environ)
