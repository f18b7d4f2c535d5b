"""Requests and responses of the operations on fleets, robots and deployment jobs."""

from . import deployment_jobs, fleets, robots

GROUPS = {"Fleets": fleets, "Robots": robots, "Deployment jobs": deployment_jobs}
"""Modules of the operations by title, in the order in which users need them."""
