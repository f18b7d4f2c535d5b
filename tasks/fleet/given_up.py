"""Marks deployment jobs as failed whose job workers keep dying, or which cannot run at all."""

from ...schemas.fleet.rollouts.rollout import Stopped
from ..catalog import Resource
from ..execution.leases.giving_up import GivenUp
from ..service.service import Service
from .catalog_rollouts import Rollouts


def _tell_robots(job: Resource, service: Service) -> None:
    """Stores the event that the deployment was stopped; the next report of a robot of it makes it cancel the orders."""
    stopped = Stopped(why="canceled")
    Rollouts(service.catalog).add_event(job.arn, stopped.to_json(), service.clock().timestamp())


KINDS = {"deployment-job": GivenUp("InternalServerError", _tell_robots)}
