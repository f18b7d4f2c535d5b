"""Pool of deployment jobs: how many run at once in a job worker."""

from ..worker.job_pools import JobPool

_AT_ONCE = 20  # they wait for robots nearly all the time

POOLS = (JobPool("deployment-job", "CreateDeploymentJob", _AT_ONCE),)
