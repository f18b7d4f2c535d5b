"""Robot applications: the programs that drive robots."""

from ...schemas.operations.robot_applications import (
    CreateRobotApplicationRequest,
    CreateRobotApplicationResponse,
    CreateRobotApplicationVersionRequest,
    CreateRobotApplicationVersionResponse,
    DeleteRobotApplicationRequest,
    DeleteRobotApplicationResponse,
    DescribeRobotApplicationRequest,
    DescribeRobotApplicationResponse,
    ListRobotApplicationsRequest,
    ListRobotApplicationsResponse,
    UpdateRobotApplicationRequest,
    UpdateRobotApplicationResponse,
)
from ..service.service import Service
from .application_versions import create_version
from .applications import (
    change_application,
    create_application,
    delete_application,
    describe_application,
    list_applications,
)
from .registry import operation


@operation("CreateRobotApplication")
def create_robot_application(
    request: CreateRobotApplicationRequest, service: Service
) -> CreateRobotApplicationResponse:
    """Stores a robot application under a name of its own."""
    return CreateRobotApplicationResponse.model_validate(create_application("robot", request.to_wire(), service))


@operation("CreateRobotApplicationVersion")
def create_robot_application_version(
    request: CreateRobotApplicationVersionRequest, service: Service
) -> CreateRobotApplicationVersionResponse:
    """Keeps a robot application as it is now under the next number."""
    return CreateRobotApplicationVersionResponse.model_validate(create_version("robot", request.to_wire(), service))


@operation("DescribeRobotApplication")
def describe_robot_application(
    request: DescribeRobotApplicationRequest, service: Service
) -> DescribeRobotApplicationResponse:
    """Tells what a robot application, or a version of it, is."""
    return DescribeRobotApplicationResponse.model_validate(describe_application("robot", request.to_wire(), service))


@operation("ListRobotApplications")
def list_robot_applications(request: ListRobotApplicationsRequest, service: Service) -> ListRobotApplicationsResponse:
    """Lists robot applications, newest first."""
    summaries, token = list_applications("ListRobotApplications", "robot", request, service)
    return ListRobotApplicationsResponse.model_validate({"robotApplicationSummaries": summaries, "nextToken": token})


@operation("UpdateRobotApplication")
def update_robot_application(
    request: UpdateRobotApplicationRequest, service: Service
) -> UpdateRobotApplicationResponse:
    """Makes a robot application something else, under the same name."""
    return UpdateRobotApplicationResponse.model_validate(change_application("robot", request.to_wire(), service))


@operation("DeleteRobotApplication")
def delete_robot_application(
    request: DeleteRobotApplicationRequest, service: Service
) -> DeleteRobotApplicationResponse:
    """Removes a robot application with all its versions, or one version of it."""
    delete_application("robot", request.to_wire(), service)
    return DeleteRobotApplicationResponse()
