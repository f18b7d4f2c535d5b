"""Simulation applications: what the robot moves in."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .base import Shape
from .common import Name, TagMap, text
from .operation_shape import CREATE_APPLICATION_ERRORS, OperationShape
from .robot_applications import (
    CreateRobotApplicationResponse,
    Environment,
    RobotSoftwareSuite,
    SourceConfigs,
    check_content,
)

SimulationSoftwareSuiteType = Literal["Gazebo", "RosbagPlay", "SimulationRuntime"]
SimulationSoftwareSuiteVersionType = Annotated[str, text(0, 1024, "7|9|11|Kinetic|Melodic|Dashing|Foxy")]
RenderingEngineType = Literal["OGRE"]
RenderingEngineVersionType = Annotated[str, text(1, 4, "1.x")]


class SimulationSoftwareSuite(Shape):
    """The simulator a simulation application is written for."""

    name: SimulationSoftwareSuiteType | None = Field(
        default=None, description="The suite; `SimulationRuntime` for the one that runs here."
    )
    version: SimulationSoftwareSuiteVersionType | None = Field(default=None, description="Its version.")


class RenderingEngine(Shape):
    """The rendering engine a Gazebo application asks for."""

    name: RenderingEngineType | None = Field(default=None, description="The engine.")
    version: RenderingEngineVersionType | None = Field(default=None, description="Its version, such as `1.x`.")


class CreateSimulationApplicationRequest(Shape):
    """Orders a simulation application."""

    name: Name = Field(description="Its name, unlike that of any other simulation application.")
    sources: SourceConfigs | None = Field(default=None, description="Archives with its files, one per architecture.")
    simulationSoftwareSuite: SimulationSoftwareSuite = Field(description="The simulator it is written for.")
    robotSoftwareSuite: RobotSoftwareSuite = Field(description="The robot software it works with.")
    renderingEngine: RenderingEngine | None = Field(default=None, description="Rendering engine, for Gazebo.")
    tags: TagMap | None = Field(default=None, description="Tags for the application.")
    environment: Environment | None = Field(default=None, description="Where it comes from, instead of archives.")

    @model_validator(mode="after")
    def _one_content(self) -> Self:
        check_content(self.sources, self.environment)
        return self


class CreateSimulationApplicationResponse(CreateRobotApplicationResponse):
    """The application that was made."""

    simulationSoftwareSuite: SimulationSoftwareSuite | None = Field(
        default=None, description="The simulator it is written for."
    )
    renderingEngine: RenderingEngine | None = Field(default=None, description="Rendering engine, for Gazebo.")


OPERATIONS = (
    OperationShape(
        "CreateSimulationApplication",
        CreateSimulationApplicationRequest,
        CreateSimulationApplicationResponse,
        CREATE_APPLICATION_ERRORS,
        "Makes a simulation application known under a name.",
    ),
)
