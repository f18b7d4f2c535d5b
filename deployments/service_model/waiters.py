"""Waiters with which SDKs wait for a job's state. AWS RoboMaker had none."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from ...schemas.lifecycles import SIMULATION_JOB, SIMULATION_JOB_BATCH, WORLD_EXPORT_JOB, WORLD_GENERATION_JOB
from ...schemas.state_machines import Lifecycle


@dataclass(frozen=True)
class Waiter:
    """Definition of an SDK waiter, which polls a job until it reaches a state."""

    name: str
    """Name of an SDK waiter."""

    operation: str
    """API operation that an SDK waiter calls."""

    lifecycle: Lifecycle[Any]
    """Lifecycle of the job that an SDK waiter polls: each final state ends the waiting."""

    delay_s: int
    """Time between two calls of an SDK waiter, in seconds."""

    most_calls: int
    """Limit of the calls that an SDK waiter makes."""

    wanted: Collection[str] = ("Completed",)
    """Job states that end an SDK waiter's waiting successfully."""

    also_failed: Collection[str] = ()
    """Job states that end an SDK waiter's waiting with a failure, although they are not final."""

    @property
    def failed(self) -> list[str]:
        """Job states in which an SDK waiter gives up."""
        return sorted({*self.lifecycle.terminal, *self.also_failed} - {*self.wanted})

    def as_model(self) -> dict[str, Any]:
        """Returns the SDK waiter in botocore's format."""
        ends = [("success", state) for state in self.wanted] + [("failure", state) for state in self.failed]
        return {
            "operation": self.operation,
            "delay": self.delay_s,
            "maxAttempts": self.most_calls,
            "acceptors": [
                {"state": end, "matcher": "path", "argument": "status", "expected": state} for end, state in ends
            ],
        }


_CRASHED = ("RunningFailed",)

WAITERS = (
    # A short job may have run and ended between two calls.
    Waiter(
        "SimulationJobRunning",
        "DescribeSimulationJob",
        SIMULATION_JOB,
        delay_s=2,
        most_calls=900,
        wanted=("Running", "Completed"),
        also_failed=_CRASHED,
    ),
    Waiter(
        "SimulationJobCompleted",
        "DescribeSimulationJob",
        SIMULATION_JOB,
        delay_s=5,
        most_calls=2880,
        also_failed=_CRASHED,
    ),
    Waiter(
        "SimulationJobBatchCompleted",
        "DescribeSimulationJobBatch",
        SIMULATION_JOB_BATCH,
        delay_s=10,
        most_calls=8640,
    ),
    Waiter(
        "WorldGenerationJobCompleted", "DescribeWorldGenerationJob", WORLD_GENERATION_JOB, delay_s=2, most_calls=1800
    ),
    Waiter("WorldExportJobCompleted", "DescribeWorldExportJob", WORLD_EXPORT_JOB, delay_s=2, most_calls=1800),
)
"""All waiters of the API model.

They wait half an hour for a simulation to start, four hours for it to end, a day for a batch, an hour for worlds.
"""


def waiters_model() -> dict[str, Any]:
    """Generates `waiters-2.json`, the waiters for AWS SDKs."""
    return {"version": 2, "waiters": {each.name: each.as_model() for each in WAITERS}}
