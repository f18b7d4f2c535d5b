"""Blocks of Prefect that keep settings: object store, catalog, credentials.

`prefect block register -m prefect_robomaker.deployments.blocks` makes their types known to a Prefect server, and they
are then made in its pages or in Python. Settings stay `ROBOMAKER_…` variables: `robomaker deploy --block TYPE/NAME` has
the Prefect worker set them from a block when it starts a run, and `open_service` opens a service with them in one's own
flow. Credentials in blocks of prefect-aws are taken by reference, so that it need not be installed: it pins an older
boto3. May import: `schemas`, `deployments.worker`, `tasks.service`. The server lists and keeps what is here; Prefect
loads it when it starts, in its workers too, so nothing slow is imported at module level.
"""

import sys

from ..worker.beside_prefect import finish_runs_beside
from .robomaker import RobomakerCatalog, RobomakerCredentials, RobomakerObjectStore, open_service

__all__ = ["RobomakerCatalog", "RobomakerCredentials", "RobomakerObjectStore", "open_service"]

finish_runs_beside(sys.argv)
