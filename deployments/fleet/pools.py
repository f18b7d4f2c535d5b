"""The pool of deployment jobs."""

from ..worker.job_pools import JobPool

_AT_ONCE = 20  # they wait for robots nearly all the time

POOLS = (JobPool("deployment-job", "CreateDeploymentJob", _AT_ONCE),)
