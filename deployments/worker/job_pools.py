"""Pools of jobs: one per kind of job, with a limit of jobs that run at the same time."""

from dataclasses import dataclass

from ...schemas.wings import parts_of_wings

_BATCHES_AT_ONCE = 4
_GENERATIONS_AT_ONCE = 2
_EXPORTS_AT_ONCE = 2


@dataclass(frozen=True)
class JobPool:
    """A kind of job with the number of such jobs that may run at once."""

    kind: str
    """Kind of the jobs of a pool, as in their ARNs."""

    operation: str
    """API operation that creates the jobs of a pool."""

    at_once: int
    """Limit of jobs of a pool that run at the same time; the others wait, oldest first."""


def job_pools(max_jobs: int) -> tuple[JobPool, ...]:
    """Returns the pools of all kinds of jobs.

    Args:
        max_jobs: Simulation jobs at once; those of batches share the machine with them.
    """
    return (
        JobPool("simulation-job", "CreateSimulationJob", max_jobs),
        JobPool("simulation-job-batch", "StartSimulationJobBatch", _BATCHES_AT_ONCE),
        # Each uses all processors.
        JobPool("world-generation-job", "CreateWorldGenerationJob", _GENERATIONS_AT_ONCE),
        JobPool("world-export-job", "CreateWorldExportJob", _EXPORTS_AT_ONCE),
        *(pool for part in parts_of_wings("deployments", "pools") for pool in part.POOLS),
    )
