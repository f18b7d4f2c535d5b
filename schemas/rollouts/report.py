"""Facts that the report of a deployment is made from."""

from pydantic import Field

from ..operations.deployment_jobs import DeploymentConfig, DeploymentJobErrorCode, DeploymentStatus
from ..wire.base import optional
from .artifacts import Delivery
from .rollout import Pause, Rollout
from .stored import StoredPart, TimeS


class DeploymentReport(StoredPart):
    """A deployment as it stands, or stood at its end."""

    job: str = Field(description="ARN of the deployment job.")
    fleet: str = Field(description="Name of its fleet.")
    application: str = Field(description="Name of the application.")
    version: str = Field(description="Version of the application.")
    status: DeploymentStatus = Field(description="Status of the job.")
    failure_code: DeploymentJobErrorCode | None = optional("Why it failed; absent if not.")
    failure_reason: str | None = optional("The same in words.")
    created_s: TimeS = Field(description="When it was ordered.")
    now_s: TimeS = Field(description="When the report is written.")
    config: DeploymentConfig = Field(description="How careful it is.")
    delivery: Delivery | None = optional("Files and launch configuration that robots get; absent: it was not prepared.")
    rollout: Rollout | None = optional("How each robot stands; absent: it has not begun.")
    notes: tuple[str, ...] = Field(
        default=(), description="Causes for which it waits, and how robots go back, in words."
    )
    closed: tuple[Pause, ...] = Field(default=(), description="When no maintenance window was open.")
    waves: tuple[tuple[str, ...], ...] = Field(default=(), description="ARNs of the robots of each wave, in order.")
