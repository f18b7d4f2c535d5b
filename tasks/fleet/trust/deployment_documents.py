"""The deployment document: what an agent is to install and launch, as a target of the repository and so signed."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from ....schemas.operations.deployment_jobs import DeploymentLaunchConfig
from .roles import target_folder

BundleSuffix = Literal["tar.gz", "zip", "tar"]
"""How a bundle's name ends, which tells an agent how to unpack it."""

_GZIP, _ZIP = b"\x1f\x8b", b"PK"


class DeploymentTargets(BaseModel):
    """Content of a deployment document; all paths are target paths."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = Field(default=1, description="Version of this document's form; agents refuse others.")
    number: int = Field(description="Rises from deployment to deployment: robots carry out none that is older.")
    job: str = Field(description="ARN of the deployment job.")
    fleet: str = Field(description="ARN of the fleet.")
    application: str = Field(description="Name of the application.")
    version: str = Field(description="Its version.")
    bundles: dict[str, str] = Field(description="Path of the archive, by architecture.")
    condition: str | None = Field(description="Path of the program that is asked before the download; null: none.")
    launch: DeploymentLaunchConfig = Field(description="How the application is started, as on the wire.")
    attestations: list[str] = Field(default=[], description="Paths of what others attest of the version.")
    batch: str | None = Field(default=None, description="ARN of the batch that has to be attested; null: none has to.")
    tags: dict[str, str] = Field(default={}, description="Tags of the deployment job.")

    def to_bytes(self) -> bytes:
        """The document as it is published."""
        launch = self.launch.model_dump(mode="json", by_alias=True, exclude_none=True)
        return self.model_copy(update={"launch": launch}).model_dump_json(warnings=False).encode()


def document_path(application: str, job_id: str) -> str:
    """Path of the document of a deployment job."""
    return f"{target_folder(application)}/deployments/{job_id}.json"


def bundle_path(application: str, sha256: str, suffix: BundleSuffix) -> str:
    """Path of an archive."""
    return f"{target_folder(application)}/bundles/{sha256}.{suffix}"


def condition_path(application: str, sha256: str) -> str:
    """Path of a program that is asked before a download."""
    return f"{target_folder(application)}/conditions/{sha256}"


def attestation_path(application: str, sha256: str) -> str:
    """Path of an attestation."""
    return f"{target_folder(application)}/attestations/{sha256}.json"


def suffix_of(beginning: bytes) -> BundleSuffix:
    """How the name of an archive ends, by its first bytes."""
    if beginning.startswith(_GZIP):
        return "tar.gz"
    return "zip" if beginning.startswith(_ZIP) else "tar"
