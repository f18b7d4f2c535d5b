"""The documents of robots, of fleets, and of the deployment jobs that bring applications to them."""

from typing import Any

from pydantic import Field

from .base import Changes, Document, FailureChanges, Json


class RobotMembership(Changes):
    """What changes of a robot: where it belongs, and what was last meant for it."""

    fleet: str | None = Field(default=None, description="ARN of its fleet; absent: it is in none.")
    last_deployment_job: str | None = Field(default=None, description="ARN of the last deployment meant for it.")


class RobotDocument(RobotMembership, Document):
    """A robot."""

    architecture: str = Field(description="Architecture of its computer.")
    greengrass_group_id: str = Field(description="Its Greengrass group.")


class FleetChanges(Changes):
    """What changes of a fleet."""

    last_deployment_job: str | None = Field(default=None, description="ARN of its last deployment job.")


class FleetDocument(FleetChanges, Document):
    """A fleet."""


class DeploymentJobDocument(FailureChanges, Document):
    """A deployment job."""

    deployment_application_configs: list[dict[str, Any]] = Field(
        description="What is deployed: one `DeploymentApplicationConfig` on the wire."
    )
    deployment_config: Json = Field(description="How, with the defaults that hold and the ETag of the condition file.")
