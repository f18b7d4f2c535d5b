"""Reports of the commands that maintain stored data: `gc`, `fsck` and `upload --kept`."""

from datetime import datetime, timedelta
from enum import StrEnum
from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional
from ..wire.errors import ConfigurationError

GcAction = Literal["remove", "thin", "keep"]
GcKind = Literal["run", "jobs", "world", "recording", "robot-files", "copies"]


class RetentionPolicy(Model):
    """Rules for which runs and worlds `robomaker gc` keeps. Everything that no rule keeps is deleted."""

    older_than: timedelta | None = optional("Everything younger is kept.")
    keep_runs: int | None = Field(default=None, ge=0, description="The newest of each specification that are kept.")
    keep_failures: bool = Field(default=False, description="Whether runs that did not succeed are kept.")
    keep_results: bool = Field(
        default=False, description="Whether only recordings, videos and logs go, and records, reports and results stay."
    )
    sdk_jobs: bool = Field(default=False, description="Whether jobs that no run of a specification made go too.")
    orphaned_worlds: bool = Field(
        default=False,
        description="Whether worlds go that were generated or varied, and that neither anything kept nor a deployed "
        "specification names.",
    )
    imported_worlds: bool = Field(default=False, description="Whether imported worlds go that nothing kept names.")
    orphaned_recordings: bool = Field(
        default=False,
        description="Whether recordings that were stored to be judged go that no job and no open run names.",
    )
    keep_deployments: int | None = Field(
        default=None,
        ge=0,
        description="The newest deployments of each fleet whose files for robots are kept; absent: all files are.",
    )

    def check(self) -> None:
        """Raises an error for a policy that would delete everything, or whose rules have no effect.

        Raises:
            ConfigurationError: Names the option and what would be right.
        """
        if self.older_than is None and self.keep_runs is None and self.keep_deployments is None:
            raise ConfigurationError("nothing says what is to be removed; --older-than 30d or --keep-runs 20 would")
        by_age = {
            "--sdk-jobs": self.sdk_jobs,
            "--orphaned-worlds": self.orphaned_worlds,
            "--imported-worlds": self.imported_worlds,
            "--orphaned-recordings": self.orphaned_recordings,
        }
        for option, asked in by_age.items():
            if asked and self.older_than is None:
                raise ConfigurationError(f"{option} goes by age: add --older-than 30d, for example")


class GcItem(Model):
    """A run, the jobs of one order, or a world, with the decision of `robomaker gc` to keep or delete it."""

    kind: GcKind = Field(
        description="`run` of a specification, `jobs` that an SDK ordered, `world`, `recording`, `robot-files` or "
        "cached `copies`."
    )
    id: str = Field(description="Id of the run; ARN of jobs and worlds.")
    name: str = Field(default="", description="Name of the specification.")
    ended_at: datetime | None = optional("When it ended, or was made; UTC.")
    state: str = Field(default="", description="State of the finished run or job.")
    action: GcAction = Field(description="`remove`; `thin`: recordings, videos and logs go; or `keep`.")
    reason: str = Field(default="", description="Why it is kept, or what of it is kept.")
    objects: int = Field(default=0, description="Objects of the store, and files of the home, that go.")
    size_bytes: int = Field(default=0, description="Total size in bytes.")
    problem: str | None = optional("Error in words: what could not be removed, and why.")


class GcFlowRuns(Model):
    """Old flow runs that `robomaker gc` removes from the local Prefect server."""

    count: int = Field(default=0, description="How many go, with their task runs, logs and artifacts.")
    note: str = Field(default="", description="Why none are looked at, or what is to be known.")
    database_bytes: int | None = optional("Size of the server's database file; absent: none.")
    freed_bytes: int = Field(default=0, description="How much of it is given back, with the rows that go or without.")
    problem: str | None = optional("Why they could not be removed.")


class GcReport(Model):
    """Report of what `robomaker gc` deleted, or would delete."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    dry_run: bool = Field(description="Whether nothing was removed.")
    policy: RetentionPolicy = Field(description="Rules that were asked for.")
    items: list[GcItem] = Field(default=[], description="Runs, jobs and worlds, oldest first.")
    flow_runs: GcFlowRuns = Field(default=GcFlowRuns(), description="Flow runs of the local Prefect server.")
    notes: list[str] = Field(default=[], description="Further remarks, in words.")

    @property
    def removed(self) -> list[GcItem]:
        """Items that are deleted, or whose recordings are deleted."""
        return [item for item in self.items if item.action != "keep"]

    @property
    def problems(self) -> list[str]:
        """Errors that occurred while deleting, each after the id of its item."""
        told = [f"{item.id}: {item.problem}" for item in self.items if item.problem]
        return [*told, *([f"Prefect: {self.flow_runs.problem}"] if self.flow_runs.problem else [])]


class Problem(StrEnum):
    """Kind of problem that `robomaker fsck` finds."""

    NOT_PUBLISHED = "not published"
    """The catalog says that outputs are stored completely, but their manifest is missing."""

    MISSING = "missing"
    """An object that a manifest or the catalog names is missing."""

    WRONG_SIZE = "wrong size"
    """An object has another size than was stored."""

    WRONG_CONTENT = "wrong content"
    """An object has another SHA-256 than was stored."""

    UNREADABLE = "unreadable"
    """The object cannot be read: no permission, no such bucket, or an invalid manifest."""

    ONLY_HERE = "only here"
    """Outputs that could not be stored when their run ended are on this machine only."""

    HALF_REMOVED = "half removed"
    """A deletion was interrupted."""

    HALF_UPLOADED = "half uploaded"
    """Parts of a large file whose upload was never completed; they take space, and are invisible to readers."""

    UNKNOWN = "unknown"
    """Outputs of a job that is not in this catalog."""


LOSSES = frozenset({Problem.NOT_PUBLISHED, Problem.MISSING, Problem.WRONG_SIZE, Problem.WRONG_CONTENT})
"""Problems that only a backup, or running the job again, repairs."""


class Finding(Model):
    """One inconsistency between catalog and object store that `robomaker fsck` found."""

    problem: Problem = Field(description="Kind of the problem.")
    resource: str | None = optional("ARN of the resource that it belongs to; absent: none.")
    where: str = Field(description="Address of the object, the folder of objects or the folder of this machine.")
    detail: str = Field(default="", description="Description of the problem.")
    remedy: str = Field(default="", description="Remedy for it, in words.")
    mended: bool = Field(default=False, description="Whether it was mended just now.")


class ConsistencyReport(Model):
    """Result of `robomaker fsck`: what was checked, and the inconsistencies found."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    read_content: bool = Field(description="Whether every object was read and its SHA-256 compared, not its size only.")
    resources: int = Field(default=0, description="How many resources were checked.")
    objects: int = Field(default=0, description="How many objects they name.")
    size_bytes: int = Field(default=0, description="Total size in bytes.")
    findings: list[Finding] = Field(default=[], description="All problems.")

    @property
    def open_findings(self) -> list[Finding]:
        """Inconsistencies that were not repaired; outputs that belong to other catalogs are left out."""
        return [each for each in self.findings if not each.mended and each.problem is not Problem.UNKNOWN]


KeptState = Literal["kept", "stored"]


class KeptRun(Model):
    """A run of a simulation job whose outputs could not be uploaded and are on this machine only."""

    job: str = Field(description="ARN of the job.")
    job_status: str = Field(description="Status of the job.")
    run_id: str = Field(description="Id of the run.")
    folder: str = Field(description="Folder of its outputs on this machine.")
    files: int = Field(description="Number of files of the run.")
    size_bytes: int = Field(description="Total size in bytes.")
    state: KeptState = Field(default="kept", description="`kept` on this machine, or `stored` now.")
    place: str | None = optional("Place in the object store where its outputs are now; absent: none.")
    problem: str | None = optional("Why they could not be stored; absent: it was not tried.")


class KeptReport(Model):
    """Runs whose outputs are on this machine only, because their upload failed: all of them, or those of one job."""

    dry_run: bool = Field(description="Whether they were only looked for.")
    runs: list[KeptRun] = Field(description="The runs, by job and time.")

    @property
    def problems(self) -> list[str]:
        """Lists the jobs whose outputs still could not be uploaded, and why, one line each."""
        return [f"{run.job}: {run.problem}" for run in self.runs if run.problem]
