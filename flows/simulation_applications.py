"""Simulation applications: the surroundings that robots are tried in."""

from typing import Any

from ..schemas.simulation_applications import CreateSimulationApplicationRequest, CreateSimulationApplicationResponse
from ..tasks.service import Service
from .applications import create_application
from .operation import flows_of, operation


@operation("CreateSimulationApplication")
def create_simulation_application(
    request: CreateSimulationApplicationRequest, service: Service
) -> CreateSimulationApplicationResponse:
    """Stores a simulation application under a name of its own."""
    answer = create_application("simulation-application", request.to_wire(), service)
    return CreateSimulationApplicationResponse.model_validate(answer)


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
