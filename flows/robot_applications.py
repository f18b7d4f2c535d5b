"""Robot applications: the programs that drive robots."""

from typing import Any

from ..schemas.robot_applications import CreateRobotApplicationRequest, CreateRobotApplicationResponse
from ..tasks.service import Service
from .applications import create_application
from .operation import flows_of, operation


@operation("CreateRobotApplication")
def create_robot_application(
    request: CreateRobotApplicationRequest, service: Service
) -> CreateRobotApplicationResponse:
    """Stores a robot application under a name of its own."""
    answer = create_application("robot-application", request.to_wire(), service)
    return CreateRobotApplicationResponse.model_validate(answer)


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
