"""Report of `robomaker upload --kept`: outputs of runs that could not be stored when they ended."""

from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional

KeptState = Literal["kept", "stored"]


class KeptRun(Model):
    """A run of a simulation job whose outputs are on this machine only."""

    job: str = Field(description="ARN of the job.")
    job_status: str = Field(description="Status of the job.")
    run_id: str = Field(description="Id of the run.")
    folder: str = Field(description="Folder of its outputs on this machine.")
    files: int = Field(description="How many files it left.")
    size_bytes: int = Field(description="Their size.")
    state: KeptState = Field(default="kept", description="`kept` on this machine, or `stored` now.")
    place: str | None = optional("Place in the object store where its outputs are now; absent: none.")
    problem: str | None = optional("Why they could not be stored; absent: it was not tried.")


class KeptReport(Model):
    """All runs whose outputs were kept, or those of one job."""

    dry_run: bool = Field(description="Whether they were only looked for.")
    runs: list[KeptRun] = Field(description="The runs, by job and time.")

    @property
    def problems(self) -> list[str]:
        """Jobs whose outputs could not be stored, and why, one line each."""
        return [f"{run.job}: {run.problem}" for run in self.runs if run.problem]
