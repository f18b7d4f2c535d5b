"""Catalog documents of physical robots, of fleets, and of the deployment jobs that install applications on them."""

from typing import Any, Literal

from pydantic import Field

from ..documents.document_base import Changes, Document, FailureChanges, Json, Part
from ..wire.base import optional


class RobotMembership(Changes):
    """Update to a robot's catalog document: the fleet it is in, and the last deployment meant for it."""

    fleet: str | None = optional("ARN of the robot's fleet; absent: none.")
    last_deployment_job: str | None = optional("ARN of the last deployment to the robot.")


class RobotEnrolment(Changes):
    """Update to a robot's catalog document: the hashes of the secret tokens by which the robot logs in."""

    token_sha256: str | None = optional("SHA-256 of the robot's token, in hexadecimal; absent: it is not enrolled.")

    kind: Literal["agent"] | None = optional("Kind of updater: this project's agent; absent: a third-party updater.")
    enrolment_sha256: str | None = optional("SHA-256 of the agent's one-time token, in hexadecimal; absent: none.")
    enrolment_expires_s: float | None = optional("Expiry of the one-time token, in seconds since the epoch.")
    enrolment_taken: str | None = optional(
        "SHA-256 of the robot token that was issued with the one-time token; absent: none."
    )
    enrolment_root: int | None = optional("Version of the update repository's root metadata that the agent trusts.")

    @property
    def has_agent(self) -> bool:
        """Whether the robot installs deployments with the project's own agent program, which runs on the robot."""
        return self.kind == "agent" or (self.token_sha256 is None and self.enrolment_sha256 is not None)


class RobotSighting(Changes):
    """Update to a robot's catalog document: the time of its last poll to the service."""

    last_seen_s: float | None = optional(
        "Time of the robot's last poll, in seconds since the epoch, accurate to a few seconds; absent: never."
    )


class RobotAttributes(Changes):
    """Update to a robot's catalog document: attributes that the robot reports about itself, such as hardware."""

    attributes: dict[str, str] | None = optional("Attributes by name; absent: the robot reported none.")


class RobotInstallation(Changes):
    """Update to a robot's catalog document: the application and version that the robot installed last."""

    installed_name: str | None = optional("Name of the installed application; absent: none yet.")
    installed_version: str | None = optional("Version of the installed application; absent: none yet.")
    installed_by: str | None = optional(
        "ARN of the deployment job that installed the application; absent in records of older releases."
    )


class RobotDocument(RobotMembership, RobotEnrolment, RobotSighting, RobotAttributes, RobotInstallation, Document):
    """Catalog document of a physical robot that receives deployments."""

    architecture: str = Field(description="Processor architecture of the robot's computer.")
    greengrass_group_id: str = Field(description="Id of the robot's Greengrass group.")

    @property
    def trouble(self) -> str | None:
        """Fault of the application that the robot's agent reports, such as that it keeps restarting; `None`: none."""
        return (self.attributes or {}).get("trouble") or None

    @property
    def installed(self) -> str | None:
        """Application and version installed last on the robot, such as `courier 1`; `None` if it has installed none."""
        return " ".join(filter(None, (self.installed_name, self.installed_version))) or None


class FleetChanges(Changes):
    """Update to a fleet's catalog document."""

    last_deployment_job: str | None = optional("ARN of the fleet's last deployment job.")


class FleetDocument(FleetChanges, Document):
    """Catalog document of a fleet, a group of physical robots that are deployed to together."""


class RobotsRolledBack(Part):
    """The robots that a deployment returns to the application version they had before an earlier deployment."""

    job: str = Field(description="ARN of the deployment job that failed.")
    robots: list[str] = Field(description="ARNs of the robots to return to an earlier version.")
    earlier: str | None = optional(
        "ARN of the deployment job that had installed that version; absent in older records."
    )


class DeploymentJobDocument(FailureChanges, Document):
    """Catalog document of a deployment job, which installs an application version on the robots of a fleet."""

    deployment_application_configs: list[dict[str, Any]] = Field(
        description="Application to deploy, a `DeploymentApplicationConfig` as in the API."
    )
    deployment_config: Json = Field(
        description="Limits of the deployment, with defaults and the ETag of the condition file."
    )
    repeats: bool = Field(
        default=False,
        description="Whether the deployment repeats an earlier one, so that robots that have it already are left out.",
    )
    rolls_back: RobotsRolledBack | None = optional(
        "Robots to which the deployment is limited, and the reason; absent: all robots of the fleet."
    )

    @property
    def required_batch(self) -> str | None:
        """ARN of the simulation job batch that has to pass before the deployment begins; `None` if none has to."""
        return self.deployment_config.get("requiresBatch")


DOCUMENTS = {"deployment-fleet": FleetDocument, "deployment-job": DeploymentJobDocument, "robot": RobotDocument}
"""Document class of each kind of resource of fleets."""
