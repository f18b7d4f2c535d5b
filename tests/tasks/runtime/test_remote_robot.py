"""Robots in processes of their own: real runs, real sockets, real clients."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.simulation_run import ApplicationPlan, RunOutcome, RunPlan, RunResult
from prefect_robomaker.tasks.runtime.agent_client import Simulation, connect
from prefect_robomaker.tasks.runtime.agent_socket import agent_socket_path
from prefect_robomaker.tasks.runtime.launcher import Launcher

BUNDLE = Path(__file__).parent / "bundles" / "trouble"
ARENA = "trouble.unusual_arena.{}"
MakePlan = Callable[..., RunPlan]


class Job:
    """A run whose robot is whoever connects."""

    def __init__(self, launcher: Launcher, plan: RunPlan) -> None:
        self.plan = plan
        self.path = agent_socket_path(plan)
        self.cancel = False
        self._outcome: RunOutcome | None = None
        self._thread = threading.Thread(target=self._carry_out, args=[launcher])
        self._thread.start()

    def _carry_out(self, launcher: Launcher) -> None:
        self._outcome = launcher.run(self.plan, lambda: "canceled" if self.cancel else None)

    def connect(self, **options: Any) -> Simulation:
        return connect(str(self.path), **options)

    def raw(self) -> socket.socket:
        """A connection that says nothing by itself."""
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(10)
        deadline = time.monotonic() + 10
        while True:
            try:
                connection.connect(str(self.path))
                return connection
            except OSError:
                assert time.monotonic() < deadline
                time.sleep(0.02)

    def outcome(self) -> RunOutcome:
        self._thread.join(20)
        assert self._outcome is not None, "the run has not ended"
        return self._outcome

    def result(self) -> RunResult:
        assert self.outcome().status == "Completed", self.outcome().failure_reason
        return RunResult.model_validate_json((self.plan.output_dir / "result.json").read_bytes())

    def assert_failed(self, code: str, *texts: str) -> None:
        outcome = self.outcome()
        assert (outcome.status, outcome.failure_code) == ("Failed", code), outcome
        for text in ("driver", *texts):
            assert text in (outcome.failure_reason or "")


@pytest.fixture
def start(launcher: Launcher, make_plan: MakePlan) -> Iterator[Callable[..., Job]]:
    """Starts a run of the `trouble` bundle whose robot application is a program."""
    jobs = []

    def start(environment: str = "make_environment", robot: dict[str, str] | None = None, **members: Any) -> Job:
        if "." in environment:
            members["simulation_application"] = ApplicationPlan(
                role="simulation", name="arena", attribute=environment, path=BUNDLE
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


def test_lockstep_to_the_end_of_the_episode(start: Callable[..., Job]) -> None:
    job = start()
    with job.connect() as simulation:
        assert (simulation.hello["job_id"], simulation.hello["seed"]) == ("sim-7", 5)
        seen = []
        for step in simulation:
            seen.append((step.step, step.observation.tolist(), step.reward, step.first()))
            simulation.act([0.5])
        assert simulation.ended_by == "environment"
    assert seen == [(i, [float(i)], None if i == 0 else 0.0, i == 0) for i in range(20)]
    result = job.result()
    assert (result.ended_by, result.metrics["steps"]) == ("environment", 20.0)
    agent = result.extra["agent"]
    assert agent.pop("mean_answer_us") > 0
    assert agent == {"mode": "lockstep", "observations": 20, "observations_dropped": 0, "actions": 20}
