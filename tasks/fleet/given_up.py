"""Deployment jobs whose job workers keep dying, or which cannot be carried out: how they are failed."""

from ...schemas.fleet.rollouts.rollout import Stopped
from ..catalog import Resource
from ..execution.job_leases import GivenUp
from ..service.service import Service
from .catalog_rollouts import Rollouts


def _tell_robots(job: Resource, service: Service) -> None:
    """Has robots told with the next thing that one of them reports."""
    stopped = Stopped(why="canceled")
    Rollouts(service.catalog).add_event(job.arn, stopped.to_json(), service.clock().timestamp())


KINDS = {"deployment-job": GivenUp("InternalServerError", _tell_robots)}
