"""Simulation applications: what the robot moves in."""

from typing import Annotated, Literal

from pydantic import Field

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import Arn, LastUpdatedAt, Name, PaginationToken, TagMap, Version, text
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
    """The simulator a simulation application is written for."""

    name: SimulationSoftwareSuiteType | None = optional("The suite; `SimulationRuntime` for the one that runs here.")
    version: SimulationSoftwareSuiteVersionType | None = optional("Its version.")


class RenderingEngine(Shape):
    """The rendering engine a Gazebo application asks for."""

    name: RenderingEngineType | None = optional("The engine.")
    version: RenderingEngineVersionType | None = optional("Its version, such as `1.x`.")


class SimulationContent(ApplicationContent):
    """Members of the requests that say what a simulation application is."""

    simulationSoftwareSuite: SimulationSoftwareSuite = Field(description="The simulator it is written for.")
    renderingEngine: RenderingEngine | None = optional("Rendering engine, for Gazebo.")


class SimulationRevision(ApplicationRevision):
    """Members of the responses that say what a simulation application is."""

    simulationSoftwareSuite: SimulationSoftwareSuite | None = optional("The simulator it is written for.")
    renderingEngine: RenderingEngine | None = optional("Rendering engine, for Gazebo.")


class CreateSimulationApplicationRequest(SimulationContent):
    """Request for a simulation application."""

    name: Name = Field(description="Its name, unlike that of any other simulation application.")
    tags: TagMap | None = optional("Tags for the application.")


class CreateSimulationApplicationResponse(SimulationRevision):
    """The application that was made."""

    tags: TagMap | None = optional("Its tags.")


class CreateSimulationApplicationVersionRequest(NewApplicationVersion):
    """Request for a numbered version of a simulation application: what it is now."""


class CreateSimulationApplicationVersionResponse(SimulationRevision):
    """The version that was made."""


class DescribeSimulationApplicationRequest(ApplicationSelection):
    """Asks for one simulation application, as it is now or one version of it."""


class DescribeSimulationApplicationResponse(SimulationRevision):
    """One simulation application, or one version of it."""

    tags: TagMap | None = optional("Tags of the application; all its versions share them.")
    imageDigest: ImageDigest | None = optional("Digest of its container image, where known.")


class ListSimulationApplicationsRequest(ApplicationListRequest):
    """Asks for simulation applications, newest first."""


class SimulationApplicationSummary(Shape):
    """One simulation application, or one version of it, in a list."""

    name: Name | None = optional("Its name.")
    arn: Arn | None = optional("ARN of the application, of all its versions.")
    version: Version | None = optional("Number of the version; `$LATEST` is what it is now.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it was last changed.")
    robotSoftwareSuite: RobotSoftwareSuite | None = optional("The robot software it works with.")
    simulationSoftwareSuite: SimulationSoftwareSuite | None = optional("The simulator it is written for.")


class ListSimulationApplicationsResponse(Shape):
    """A page of simulation applications."""

    simulationApplicationSummaries: (
        Annotated[list[SimulationApplicationSummary], ShapeName("SimulationApplicationSummaries", 0, 100)] | None
    ) = optional("Simulation applications, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class UpdateSimulationApplicationRequest(ApplicationUpdate, SimulationContent):
    """Makes a simulation application what the request says, whatever it was; its name and versions stay."""


class UpdateSimulationApplicationResponse(SimulationRevision):
    """The application as it is now."""


class DeleteSimulationApplicationRequest(ApplicationSelection):
    """Removes a simulation application with all its versions, or one version of it."""


class DeleteSimulationApplicationResponse(Shape):
    """Nothing: what was to be removed is not there any more."""


OPERATIONS = application_operations(
    "simulation",
    create=CreateSimulationApplicationRequest,
    create_version=CreateSimulationApplicationVersionRequest,
    describe=DescribeSimulationApplicationRequest,
    list_page=ListSimulationApplicationsRequest,
    update=UpdateSimulationApplicationRequest,
    delete=DeleteSimulationApplicationRequest,
)
