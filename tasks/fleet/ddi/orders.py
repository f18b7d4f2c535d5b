"""An order for one robot: which file it shall install, and what it shall launch."""

import re
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ....schemas.fleet.operations.deployment_jobs import DeploymentLaunchConfig

MAX_ACTION_ID = 2**31 - 1
"""Largest number of an order: SWUpdate turns larger ones into this one, and texts into 0."""

ROBOT_ID = r"[A-Za-z0-9][A-Za-z0-9._-]{0,254}"
"""Pattern of robots' ids: updaters put ids into URLs unescaped."""

RobotId = Annotated[str, Field(pattern=f"^{ROBOT_ID}$")]
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._+-]{0,254}$")]


def is_robot_id(text: str) -> bool:
    """Whether a text can be a robot's id in the URLs of robot updaters."""
    return re.fullmatch(ROBOT_ID, text) is not None


class RobotOrder(BaseModel):
    """Update order for one robot: the file to install, and how to launch it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    action_id: int = Field(ge=1, le=MAX_ACTION_ID, strict=True, description="Number of the order, unique in the fleet.")
    robot: RobotId = Field(description="Id of the robot.")
    name: str = Field(min_length=1, max_length=255, description="Name of the application.")
    version: str = Field(min_length=1, max_length=255, description="Its version.")
    file_name: FileName = Field(description="Name of the file to install; SWUpdate takes only `.swu`.")
    size_bytes: int = Field(ge=1, description="Length of the file, in bytes.")
    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="The file's SHA-256, in hexadecimal digits.")
    sha1: str = Field(pattern="^[0-9a-f]{40}$", description="The file's SHA-1; SWUpdate requires it.")
    md5: str = Field(pattern="^[0-9a-f]{32}$", description="The file's MD5.")
    launch: DeploymentLaunchConfig | None = Field(
        default=None, description="Launch configuration of the application; third-party updaters do not read it."
    )
    target: str | None = Field(
        default=None, description="Path of the signed deployment document that an agent fetches; absent: none."
    )
    tags: dict[str, str] | None = Field(default=None, description="Tags of the robot, for its agent; absent: none.")
