"""Findings of `robomaker fsck`: disagreements between catalog and object store."""

from enum import StrEnum
from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional


class Problem(StrEnum):
    """Kind of problem that `robomaker fsck` finds."""

    NOT_PUBLISHED = "not published"
    """The catalog says that something is stored whole, and no manifest is there."""

    MISSING = "missing"
    """An object that is named is not there."""

    WRONG_SIZE = "wrong size"
    """An object has another size than was stored."""

    WRONG_CONTENT = "wrong content"
    """An object has another SHA-256 than was stored."""

    UNREADABLE = "unreadable"
    """It cannot be looked at: no permission, no such bucket, no manifest in what should be one."""

    ONLY_HERE = "only here"
    """Outputs that could not be stored when their run ended are on this machine only."""

    HALF_REMOVED = "half removed"
    """A removal was interrupted in the midst."""

    HALF_UPLOADED = "half uploaded"
    """Parts of a large file that was never uploaded to its end; they cost space, and no reader sees them."""

    UNKNOWN = "unknown"
    """Outputs of a job that this catalog does not know."""


LOSSES = frozenset({Problem.NOT_PUBLISHED, Problem.MISSING, Problem.WRONG_SIZE, Problem.WRONG_CONTENT})
"""Problems that only a backup, or doing it again, cures."""


class Finding(Model):
    """One problem."""

    problem: Problem = Field(description="Kind of the problem.")
    resource: str | None = optional("ARN of the resource that it belongs to; absent: none.")
    where: str = Field(description="Address of the object, the folder of objects or the folder of this machine.")
    detail: str = Field(default="", description="The same in words.")
    remedy: str = Field(default="", description="Remedy for it, in words.")
    mended: bool = Field(default=False, description="Whether it was mended just now.")


class ConsistencyReport(Model):
    """Scope of a check, and its findings."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    read_content: bool = Field(description="Whether every object was read and its SHA-256 compared, not its size only.")
    resources: int = Field(default=0, description="How many resources were checked.")
    objects: int = Field(default=0, description="How many objects they name.")
    size_bytes: int = Field(default=0, description="Their size.")
    findings: list[Finding] = Field(default=[], description="All problems.")

    @property
    def open_findings(self) -> list[Finding]:
        """The problems that were not mended, but for outputs of other catalogs, which are none of this one."""
        return [each for each in self.findings if not each.mended and each.problem is not Problem.UNKNOWN]
