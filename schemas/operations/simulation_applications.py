"""Operations on simulation applications: the environments in which a robot is simulated."""

from typing import Annotated, Literal

from pydantic import Field

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import Arn, LastUpdatedAt, Name, PaginationToken, Version, text
from ..wire.tags import TagMap
from .applications import (
    ApplicationContent,
    ApplicationListRequest,
    ApplicationRevision,
    ApplicationSelection,
    ApplicationUpdate,
    ImageDigest,
    NewApplicationVersion,
    RobotSoftwareSuite,
    application_operations,
)

SimulationSoftwareSuiteType = Annotated[
    Literal["Gazebo", "RosbagPlay", "SimulationRuntime"], ShapeName("SimulationSoftwareSuiteType")
]
SimulationSoftwareSuiteVersionType = Annotated[
    str, ShapeName("SimulationSoftwareSuiteVersionType"), text(0, 1024, "7|9|11|Kinetic|Melodic|Dashing|Foxy")
]
RenderingEngineType = Annotated[Literal["OGRE"], ShapeName("RenderingEngineType")]
RenderingEngineVersionType = Annotated[str, ShapeName("RenderingEngineVersionType"), text(1, 4, "1.x")]


class SimulationSoftwareSuite(Shape):
    """Name and version of the simulator (such as MuJoCo or Gazebo) that a simulation application is written for."""

    name: SimulationSoftwareSuiteType | None = optional("The suite; `SimulationRuntime` for the one that runs here.")
    version: SimulationSoftwareSuiteVersionType | None = optional("Its version.")


class RenderingEngine(Shape):
    """Name and version of the rendering engine that a Gazebo simulation application asks for."""

    name: RenderingEngineType | None = optional("The engine.")
    version: RenderingEngineVersionType | None = optional("Its version, such as `1.x`.")


class SimulationContent(ApplicationContent):
    """Members that requests to create or update a simulation application share."""

    simulationSoftwareSuite: SimulationSoftwareSuite = Field(description="The simulator it is written for.")
    renderingEngine: RenderingEngine | None = optional("Rendering engine, for Gazebo.")


class SimulationRevision(ApplicationRevision):
    """Members that responses about a simulation application share."""

    simulationSoftwareSuite: SimulationSoftwareSuite | None = optional("The simulator it is written for.")
    renderingEngine: RenderingEngine | None = optional("Rendering engine, for Gazebo.")


class CreateSimulationApplicationRequest(SimulationContent):
    """Request of `CreateSimulationApplication`: registers a simulation application (the simulated environment)."""

    name: Name = Field(description="Its name, unlike that of any other simulation application.")
    tags: TagMap | None = optional("Tags for the application.")


class CreateSimulationApplicationResponse(SimulationRevision):
    """Response of `CreateSimulationApplication`: the application that was created."""

    tags: TagMap | None = optional("Its tags.")


class CreateSimulationApplicationVersionRequest(NewApplicationVersion):
    """Request of `CreateSimulationApplicationVersion`: saves a simulation application as a numbered version."""


class CreateSimulationApplicationVersionResponse(SimulationRevision):
    """Response of `CreateSimulationApplicationVersion`: the numbered version that was created."""


class DescribeSimulationApplicationRequest(ApplicationSelection):
    """Request of `DescribeSimulationApplication`: names the simulation application, or the version of it."""


class DescribeSimulationApplicationResponse(SimulationRevision):
    """Response of `DescribeSimulationApplication`: one simulation application, or one version of it."""

    tags: TagMap | None = optional("Tags of the application; all its versions share them.")
    imageDigest: ImageDigest | None = optional("Digest of its container image, where known.")


class ListSimulationApplicationsRequest(ApplicationListRequest):
    """Request of `ListSimulationApplications`: asks for a page of simulation applications, newest first."""


class SimulationApplicationSummary(Shape):
    """Summary of a simulation application, or of one version of it, as `ListSimulationApplications` shows it."""

    name: Name | None = optional("Its name.")
    arn: Arn | None = optional("ARN of the application, of all its versions.")
    version: Version | None = optional("Number of the version; `$LATEST` is what it is now.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it was last changed.")
    robotSoftwareSuite: RobotSoftwareSuite | None = optional("The robot software it works with.")
    simulationSoftwareSuite: SimulationSoftwareSuite | None = optional("The simulator it is written for.")


class ListSimulationApplicationsResponse(Shape):
    """Response of `ListSimulationApplications`: one page of simulation applications."""

    simulationApplicationSummaries: (
        Annotated[list[SimulationApplicationSummary], ShapeName("SimulationApplicationSummaries", 0, 100)] | None
    ) = optional("Simulation applications, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class UpdateSimulationApplicationRequest(ApplicationUpdate, SimulationContent):
    """Request of `UpdateSimulationApplication`: replaces the content of a simulation application.

    Its name and versions stay.
    """


class UpdateSimulationApplicationResponse(SimulationRevision):
    """Response of `UpdateSimulationApplication`: the updated application."""


class DeleteSimulationApplicationRequest(ApplicationSelection):
    """Request of `DeleteSimulationApplication`: deletes a simulation application or one version of it.

    Without a version, all versions are deleted, too.
    """


class DeleteSimulationApplicationResponse(Shape):
    """Response of `DeleteSimulationApplication`: empty, the application or version is deleted."""


OPERATIONS = application_operations(
    "simulation",
    create=CreateSimulationApplicationRequest,
    create_version=CreateSimulationApplicationVersionRequest,
    describe=DescribeSimulationApplicationRequest,
    list_page=ListSimulationApplicationsRequest,
    update=UpdateSimulationApplicationRequest,
    delete=DeleteSimulationApplicationRequest,
)
