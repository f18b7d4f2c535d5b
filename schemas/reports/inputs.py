"""Inputs of runs and of their jobs: what a result was made of, so that those of two nights can be compared."""

from pydantic import Field

from ..runs.programs import ApplicationRole
from ..wire.base import Model, optional


class SourceCommit(Model):
    """The Git commit of the folder that a specification was in."""

    commit: str = Field(description="The commit's full hash.")
    changed: bool = Field(description="Whether files that Git tracks differed from it.")


class UsedApplication(Model):
    """An application as a job ran it."""

    role: ApplicationRole = Field(description="Robot or simulation application.")
    name: str = Field(description="Its name in the catalog.")
    digest: str = Field(description="SHA-256 of its files, or the id of its container image.")


class JobInputs(Model):
    """Inputs that decide the result of a job, as far as they are known: nights are compared by them.

    It is kept in records, and asks less than `ReuseInputs`, by which results are taken over: two jobs of one name and
    request are the same job on two nights, whatever robot, versions and places of outputs they have.
    """

    seed: int | None = optional("Its seed; absent: it never became a job.")
    seed_given: bool = Field(description="Whether the request named the seed; otherwise it was drawn by chance.")
    world: str | None = optional(
        "Name of the world's content, the same for the same world of every night; its ARN where the world "
        "is deleted and its content not known."
    )
    applications: list[UsedApplication] = Field(
        default=[], description="Its applications; one that was never started is missing."
    )
    requirements_sha256: str | None = optional(
        "SHA-256 of the requirements that its request names; absent: it names none."
    )
    request_sha256: str = Field(
        description="SHA-256 of what its request asks for: applications, launch configurations, data, limits and "
        "requirements, without ARNs, which are others every night."
    )
