"""Orders of runs: all that another process needs to finish a run whose process has died."""

from datetime import datetime
from pathlib import Path

from pydantic import Field

from .job_owners import JobOwner, NeededEnvironment
from .reports.inputs import SourceCommit
from .reports.run_record import Interruption, RerunOf
from .wire.base import Model, optional


class Order(Model):
    """A run of a specification, kept in the run's folder until it has ended."""

    run_id: str = Field(description="Id of the run; its folder exists.")
    text: str = Field(description="The specification, which may hold secrets.")
    filename: str = Field(description="Name of the file in problems.")
    spec_path: str = Field(description="The file that the record names: that of the package, or the one in the folder.")
    command: list[str] = Field(description="The command that runs it again.")
    rerun_of: RerunOf | None = optional("Earlier run that runs again; absent: it is no rerun.")
    key_id: str | None = optional("Id of the visitor's access key; absent: none is asked for.")
    address: str | None = optional("Network address of the visitor, for the audit log.")
    audit_log: Path | None = optional("The server's audit log; absent: there is none.")
    name: str | None = optional("Name of the run; absent: that of the specification.")
    seed: int | None = optional("Seed in place of those of the specification; absent: none.")
    reuse: bool = Field(default=False, description="Whether it may take over worlds and results of earlier runs.")
    started_at: datetime | None = optional("When it began, UTC; absent: when its process begins.")
    source: SourceCommit | None = optional("Git commit of the specification's folder; absent: it was in none.")
    owner: JobOwner | None = optional("The process that carries it out, or did last.")
    needed: NeededEnvironment | None = optional(
        "The environment in which it was ordered; absent: any process may finish it."
    )
    flow_run: str | None = optional("Id of the flow run of its process; absent: not known.")
    deployment: str | None = optional("Id of the Prefect deployment that it is a run of; absent: of none.")
    interruptions: list[Interruption] = Field(default=[], description="When its processes died, the first one first.")
