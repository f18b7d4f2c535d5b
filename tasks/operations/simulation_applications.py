"""Simulation applications: the surroundings that robots are tried in."""

from ...schemas.operations.simulation_applications import (
    CreateSimulationApplicationRequest,
    CreateSimulationApplicationResponse,
    CreateSimulationApplicationVersionRequest,
    CreateSimulationApplicationVersionResponse,
    DeleteSimulationApplicationRequest,
    DeleteSimulationApplicationResponse,
    DescribeSimulationApplicationRequest,
    DescribeSimulationApplicationResponse,
    ListSimulationApplicationsRequest,
    ListSimulationApplicationsResponse,
    UpdateSimulationApplicationRequest,
    UpdateSimulationApplicationResponse,
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


@operation("CreateSimulationApplication")
def create_simulation_application(
    request: CreateSimulationApplicationRequest, service: Service
) -> CreateSimulationApplicationResponse:
    """Stores a simulation application under a name of its own."""
    return CreateSimulationApplicationResponse.model_validate(
        create_application("simulation", request.to_wire(), service)
    )


@operation("CreateSimulationApplicationVersion")
def create_simulation_application_version(
    request: CreateSimulationApplicationVersionRequest, service: Service
) -> CreateSimulationApplicationVersionResponse:
    """Keeps a simulation application as it is now under the next number."""
    return CreateSimulationApplicationVersionResponse.model_validate(
        create_version("simulation", request.to_wire(), service)
    )


@operation("DescribeSimulationApplication")
def describe_simulation_application(
    request: DescribeSimulationApplicationRequest, service: Service
) -> DescribeSimulationApplicationResponse:
    """Tells what a simulation application, or a version of it, is."""
    return DescribeSimulationApplicationResponse.model_validate(
        describe_application("simulation", request.to_wire(), service)
    )


@operation("ListSimulationApplications")
def list_simulation_applications(
    request: ListSimulationApplicationsRequest, service: Service
) -> ListSimulationApplicationsResponse:
    """Lists simulation applications, newest first."""
    summaries, token = list_applications("ListSimulationApplications", "simulation", request, service)
    return ListSimulationApplicationsResponse.model_validate(
        {"simulationApplicationSummaries": summaries, "nextToken": token}
    )


@operation("UpdateSimulationApplication")
def update_simulation_application(
    request: UpdateSimulationApplicationRequest, service: Service
) -> UpdateSimulationApplicationResponse:
    """Makes a simulation application something else, under the same name."""
    return UpdateSimulationApplicationResponse.model_validate(
        change_application("simulation", request.to_wire(), service)
    )


@operation("DeleteSimulationApplication")
def delete_simulation_application(
    request: DeleteSimulationApplicationRequest, service: Service
) -> DeleteSimulationApplicationResponse:
    """Removes a simulation application with all its versions, or one version of it."""
    delete_application("simulation", request.to_wire(), service)
    return DeleteSimulationApplicationResponse()
