"""The documents of robots, of fleets, and of the deployment jobs that bring applications to them."""

from typing import Any, Literal

from pydantic import Field

from ..documents.base import Changes, Document, FailureChanges, Json, Part
from ..wire.base import optional


class RobotMembership(Changes):
    """Members of a robot's document that change: its fleet, and the last deployment meant for it."""

    fleet: str | None = optional("ARN of its fleet; absent: it is in none.")
    last_deployment_job: str | None = optional("ARN of the last deployment meant for it.")


class RobotEnrolment(Changes):
    """How a robot proves who it is."""

    token_sha256: str | None = optional("SHA-256 of its token, in hexadecimal digits; absent: it is not enrolled.")

    kind: Literal["agent"] | None = optional("Kind of updater: our own agent; absent: an updater of others.")
    enrolment_sha256: str | None = optional(
        "SHA-256 of the one-time token of an agent, in hexadecimal digits; absent: none."
    )
    enrolment_expires_s: float | None = optional("Until when that token is taken, in seconds since the epoch.")
    enrolment_taken: str | None = optional(
        "SHA-256 of the robot's token that came with the one-time token; absent: none came."
    )
    enrolment_root: int | None = optional("Version of the root of the repository that the agent is to trust.")

    @property
    def has_agent(self) -> bool:
        """Whether an agent runs on it, or is about to, since nothing else does."""
        return self.kind == "agent" or (self.token_sha256 is None and self.enrolment_sha256 is not None)


class RobotSighting(Changes):
    """When a robot was there."""

    last_seen_s: float | None = optional(
        "When it polled last, in seconds since the epoch, to a few seconds; absent: never."
    )


class RobotAttributes(Changes):
    """Attributes that a robot reports about itself."""

    attributes: dict[str, str] | None = optional("Texts by name; absent: it said nothing.")


class RobotInstallation(Changes):
    """Application and version that a robot installed last."""

    installed_name: str | None = optional("Name of the application; absent: none yet.")
    installed_version: str | None = optional("Its version; absent: none yet.")
    installed_by: str | None = optional("ARN of the deployment job that brought it; absent: an older release noted it.")


class RobotDocument(RobotMembership, RobotEnrolment, RobotSighting, RobotAttributes, RobotInstallation, Document):
    """A robot."""

    architecture: str = Field(description="Architecture of its computer.")
    greengrass_group_id: str = Field(description="Its Greengrass group.")

    @property
    def installed(self) -> str | None:
        """Application and version that it installed last, such as `courier 1`; `None`: it has installed nothing."""
        return " ".join(filter(None, (self.installed_name, self.installed_version))) or None


class FleetChanges(Changes):
    """Members of a fleet's document that change."""

    last_deployment_job: str | None = optional("ARN of its last deployment job.")


class FleetDocument(FleetChanges, Document):
    """A fleet."""


class RobotsRolledBack(Part):
    """Robots that a deployment brings back to the version that they had before another one."""

    job: str = Field(description="ARN of the deployment job that failed.")
    robots: list[str] = Field(description="ARNs of the robots.")
    earlier: str | None = optional("ARN of the deployment job that had brought that version; absent in older ones.")


class DeploymentJobDocument(FailureChanges, Document):
    """A deployment job."""

    deployment_application_configs: list[dict[str, Any]] = Field(
        description="Application to deploy: one `DeploymentApplicationConfig` on the wire."
    )
    deployment_config: Json = Field(description="How, with the defaults that hold and the ETag of the condition file.")
    repeats: bool = Field(
        default=False, description="Whether it repeats an earlier one, so that robots that are in sync are left alone."
    )
    rolls_back: RobotsRolledBack | None = optional(
        "The only robots that it is meant for, and why; absent: it is made by a call."
    )

    @property
    def required_batch(self) -> str | None:
        """ARN of the simulation job batch that has to have passed with what is deployed; `None`: none has to."""
        return self.deployment_config.get("requiresBatch")


DOCUMENTS = {"deployment-fleet": FleetDocument, "deployment-job": DeploymentJobDocument, "robot": RobotDocument}
"""Document class of each kind of resource."""
