"""Files that robots of a rollout download: one for each architecture, and another for agents."""

from pydantic import Field

from ..operations.deployment_jobs import DeploymentLaunchConfig
from ..wire.base import optional
from .stored import StoredPart


class Artifact(StoredPart):
    """A file that robots install, as orders describe it; it lies in the object store."""

    bucket: str = Field(description="Its bucket.")
    key: str = Field(description="Its key.")
    file_name: str = Field(description="Its name in orders; SWUpdate takes only `.swu`.")
    size_bytes: int = Field(ge=1, description="Its length, in bytes.")
    sha256: str = Field(description="Its SHA-256, in hexadecimal digits.")
    sha1: str = Field(description="Its SHA-1, in hexadecimal digits.")
    md5: str = Field(description="Its MD5, in hexadecimal digits.")
    archive_sha256: str | None = optional(
        "SHA-256 of the application's archive in it, in hexadecimal digits; absent: it is the archive."
    )
    name: str = Field(description="Name of the application in it.")
    version: str = Field(description="Version of the application in it.")
    target: str | None = optional("Path of the signed deployment document that an agent fetches; absent: none.")

    @property
    def delivers(self) -> str:
        """SHA-256 of the application's archive that a robot gets by it, in hexadecimal digits."""
        return self.archive_sha256 or self.sha256


class Delivery(StoredPart):
    """Files and launch configuration that the robots of a rollout get; they do not change."""

    artifacts: dict[str, Artifact] = Field(description="The files of updaters of others, by architecture.")
    agent_artifacts: dict[str, Artifact] = Field(default={}, description="The files of agents, by architecture.")
    agents: frozenset[str] = Field(default=frozenset(), description="The robots that have an agent, by ARN.")
    architectures: dict[str, str] = Field(description="The architecture of each robot that gets one, by ARN.")
    launch: DeploymentLaunchConfig = Field(description="How the application is started.")

    def by_robot(self) -> dict[str, Artifact]:
        """The file of each robot, by ARN."""
        return {robot: self._files(robot)[architecture] for robot, architecture in self.architectures.items()}

    def _files(self, robot: str) -> dict[str, Artifact]:
        return self.agent_artifacts if robot in self.agents else self.artifacts
