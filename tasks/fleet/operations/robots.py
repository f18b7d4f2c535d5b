"""Handlers of operations on robots, the machines that are registered with fleets."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from ....schemas.fleet.documents import RobotDocument
from ....schemas.fleet.operations.robots import (
    CreateRobotRequest,
    CreateRobotResponse,
    DeleteRobotRequest,
    DeregisterRobotRequest,
    DeregisterRobotResponse,
    DescribeRobotRequest,
    ListRobotsRequest,
    RegisterRobotRequest,
    RegisterRobotResponse,
)
from ....schemas.wire.arns import ResourceArn, application_arn
from ....schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from ...catalog import Resource
from ...operations.registry import Answer, operation, page_of
from ...service.service import Service
from ..fleet_records import ROBOT, fleet_held, put_into_fleet, take_out_of_fleet
from ..kept_rollouts import note_departure

_PAGE = 200


@operation("CreateRobot")
def create_robot(request: CreateRobotRequest, service: Service) -> CreateRobotResponse:
    """Handles `CreateRobot`: stores a robot under a unique name, with the status Available and without a fleet.

    An error is raised if the name is taken.
    """
    settings = service.settings
    arn = application_arn(settings.region, settings.account, ROBOT, request.name, service.clock())
    robot = service.catalog.create(
        Resource.new(
            arn=arn,
            kind=ROBOT,
            id=ResourceArn.parse(arn).id,
            name=request.name,
            status="Available",
            tags=request.tags,
            document=RobotDocument(
                architecture=request.architecture, greengrass_group_id=request.greengrassGroupId, fleet=None
            ),
        ),
        token=None,
        unique_name=True,
    )
    return CreateRobotResponse(
        arn=robot.arn,
        name=robot.name,
        createdAt=robot.created_at,
        greengrassGroupId=request.greengrassGroupId,
        architecture=request.architecture,
        tags=dict(robot.tags),
    )


@operation("DescribeRobot")
def describe_robot(request: DescribeRobotRequest, service: Service) -> Answer:
    """Handles `DescribeRobot`: returns the robot's data, fleet and last deployment."""
    robot = service.catalog.get(_checked(request.robot), kind=ROBOT)
    (summary,) = robot_summaries([robot], service)
    group = summary.pop("greenGrassGroupId")
    return {**summary, "greengrassGroupId": group, "tags": dict(robot.tags)}


@operation("ListRobots")
def list_robots(request: ListRobotsRequest, service: Service) -> Answer:
    """Handles `ListRobots`: lists robots, newest first."""
    page = page_of(request, ROBOT, service, "status", "fleetName", most=_PAGE)
    return {"robots": robot_summaries(page.resources, service), "nextToken": page.next_token}


@operation("DeleteRobot")
def delete_robot(request: DeleteRobotRequest, service: Service) -> Answer:
    """Handles `DeleteRobot`: deletes a robot, and tells its fleet's deployments; does nothing if it is deleted."""
    robot = _checked(request.robot)
    with suppress(ResourceNotFoundException):
        fleet = RobotDocument.of(service.catalog.get(robot, kind=ROBOT)).fleet
        service.catalog.delete(robot)
        if fleet is not None:
            note_departure(robot, fleet, "deleted", service)
    return {}


@operation("RegisterRobot")
def register_robot(request: RegisterRobotRequest, service: Service) -> RegisterRobotResponse:
    """Handles `RegisterRobot`: adds a robot to a fleet; does nothing if it is in that fleet.

    An error is raised if it is in another one, or either does not exist.
    """
    robot = _checked(request.robot)
    with fleet_held(request.fleet, service) as fleet:
        put_into_fleet(robot, fleet, service)
    return RegisterRobotResponse(fleet=request.fleet, robot=robot)


@operation("DeregisterRobot")
def deregister_robot(request: DeregisterRobotRequest, service: Service) -> DeregisterRobotResponse:
    """Handles `DeregisterRobot`: removes a robot from its fleet; does nothing if it is in no fleet.

    Raises InvalidParameterException if it is in another fleet.
    """
    robot = _checked(request.robot)
    with fleet_held(request.fleet, service) as fleet:
        there = RobotDocument.of(service.catalog.get(robot, kind=ROBOT)).fleet
        if there not in (None, fleet.arn):
            raise InvalidParameterException(f"robot: {robot} is registered with {there}, not with {fleet.arn}")
        if there is not None:
            take_out_of_fleet(robot, service)
            note_departure(robot, fleet.arn, "left", service)
    return DeregisterRobotResponse(fleet=request.fleet, robot=robot)


def robot_summaries(robots: Sequence[Resource], service: Service) -> list[dict[str, Any]]:
    """Makes the entries of robots for a list response, in the same order."""
    meant = {last for robot in robots if (last := RobotDocument.of(robot).last_deployment_job) is not None}
    jobs = service.catalog.get_many(meant)
    return [_summary(robot, jobs) for robot in robots]


def _summary(robot: Resource, jobs: Mapping[str, Resource]) -> dict[str, Any]:
    document = RobotDocument.of(robot)
    job = jobs.get(document.last_deployment_job or "")
    return {
        "arn": robot.arn,
        "name": robot.name,
        "fleetArn": document.fleet,
        "status": robot.status,
        "greenGrassGroupId": document.greengrass_group_id,
        "createdAt": robot.created_at,
        "architecture": document.architecture,
        "lastDeploymentJob": job and job.arn,
        "lastDeploymentTime": job and job.created_at,
    }


def _checked(arn: str) -> str:
    return str(ResourceArn.parse(arn, "robot"))
