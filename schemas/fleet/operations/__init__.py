"""The requests and responses of fleets, robots and deployment jobs."""

from . import deployment_jobs, fleets, robots

GROUPS = {"Fleets": fleets, "Robots": robots, "Deployment jobs": deployment_jobs}
"""The modules by what they are about, in the order in which one needs them."""
