"""Handlers of operations on fleets, the groups of robots to which applications are deployed."""

from collections.abc import Sequence
from contextlib import suppress
from datetime import timedelta
from typing import Any

from ....schemas.documents.document_base import FailureChanges
from ....schemas.fleet.documents import FleetDocument
from ....schemas.fleet.operations.fleets import (
    CreateFleetRequest,
    CreateFleetResponse,
    DeleteFleetRequest,
    DescribeFleetRequest,
    ListFleetsRequest,
)
from ....schemas.wire.arns import ResourceArn, application_arn
from ....schemas.wire.errors import ResourceAlreadyExistsException, ResourceNotFoundException, ThrottlingException
from ...catalog import Resource
from ...operations.registry import Answer, operation, page_of
from ...service.service import Service
from ..fleet_records import FLEET, end_deployment, fleet_held, last_deployment, robots_of, take_out_of_fleet
from .robots import robot_summaries

_PAGE = 200
_NAMESAKES = 1000  # how many fleets of one name a millisecond may bring before callers have to wait


@operation("CreateFleet")
def create_fleet(request: CreateFleetRequest, service: Service) -> CreateFleetResponse:
    """Handles `CreateFleet`: stores a fleet. Names may repeat, as the ARN contains the creation time."""
    fleet = _stored(request, service)
    return CreateFleetResponse(arn=fleet.arn, name=fleet.name, createdAt=fleet.created_at, tags=dict(fleet.tags))


@operation("DescribeFleet")
def describe_fleet(request: DescribeFleetRequest, service: Service) -> Answer:
    """Handles `DescribeFleet`: returns the fleet's robots and the state of its last deployment."""
    fleet = service.catalog.get(_checked(request.fleet), kind=FLEET)
    (summary,) = _summaries([fleet], service)
    robots = robot_summaries(robots_of(fleet.arn, service), service)
    return {**summary, "robots": robots, "tags": dict(fleet.tags)}


@operation("ListFleets")
def list_fleets(request: ListFleetsRequest, service: Service) -> Answer:
    """Handles `ListFleets`: lists fleets, newest first."""
    page = page_of(request, FLEET, service, "name", most=_PAGE)
    return {"fleetDetails": _summaries(page.resources, service), "nextToken": page.next_token}


@operation("DeleteFleet")
def delete_fleet(request: DeleteFleetRequest, service: Service) -> Answer:
    """Handles `DeleteFleet`: deletes a fleet, deregisters its robots, and fails an unfinished deployment.

    Deleting a fleet that does not exist is no error.
    """
    arn = _checked(request.fleet)
    with suppress(ResourceNotFoundException), fleet_held(arn, service) as fleet:
        _empty(fleet, service)
        service.catalog.delete(arn)
    return {}


def _stored(request: CreateFleetRequest, service: Service) -> Resource:
    settings, now = service.settings, service.clock()
    for later_ms in range(_NAMESAKES):
        moment = now + timedelta(milliseconds=later_ms)
        arn = application_arn(settings.region, settings.account, FLEET, request.name, moment)
        fleet = Resource.new(
            arn=arn,
            kind=FLEET,
            id=ResourceArn.parse(arn).id,
            name=request.name,
            tags=request.tags,
            document=FleetDocument(),
        )
        try:
            return service.catalog.create(fleet, token=None)
        except ResourceAlreadyExistsException:
            continue  # a namesake of the same millisecond
    raise ThrottlingException(f"name: too many fleets named {request.name!r} are being made at once; try again")


def _empty(fleet: Resource, service: Service) -> None:
    if (deployment := last_deployment(fleet.arn, service)) is not None:
        failure = FailureChanges(
            failure_code="DeploymentFleetDoesNotExist",
            failure_reason=f"{fleet.arn} was deleted before the deployment ended",
        )
        end_deployment(deployment, "fleet_deleted", service, failure)
    for robot in robots_of(fleet.arn, service):
        with suppress(ResourceNotFoundException):  # robots may be deleted at any time
            take_out_of_fleet(robot.arn, service)


def _summaries(fleets: Sequence[Resource], service: Service) -> list[dict[str, Any]]:
    """Returns the list entries of fleets, in the same order."""
    last = {fleet.arn: FleetDocument.of(fleet).last_deployment_job or "" for fleet in fleets}
    jobs = service.catalog.get_many(filter(None, last.values()))
    return [_summary(fleet, jobs.get(last[fleet.arn])) for fleet in fleets]


def _summary(fleet: Resource, deployment: Resource | None) -> dict[str, Any]:
    return {
        "name": fleet.name,
        "arn": fleet.arn,
        "createdAt": fleet.created_at,
        "lastDeploymentStatus": deployment and deployment.status,
        "lastDeploymentJob": deployment and deployment.arn,
        "lastDeploymentTime": deployment and deployment.created_at,
    }


def _checked(arn: str) -> str:
    return str(ResourceArn.parse(arn, "deployment-fleet"))
