"""What a visitor orders: a specification, and for whom it is run."""

from pathlib import Path

from pydantic import Field

from ...schemas.reports.run_record import RerunOf
from ...schemas.wire.base import Model


class Order(Model):
    """A run of a specification; the process that carries it out reads it from its standard input."""

    run_id: str = Field(description="Id of the run; its folder exists.")
    text: str = Field(description="The specification, which may hold secrets.")
    filename: str = Field(description="What problems call the file.")
    spec_path: str = Field(description="The file that the record names: that of the package, or the one in the folder.")
    command: list[str] = Field(description="The command that runs it again.")
    rerun_of: RerunOf | None = Field(default=None, description="What is run again; absent: it is no rerun.")
    key_id: str | None = Field(default=None, description="Id of the visitor's access key; absent: none is asked for.")
    address: str | None = Field(default=None, description="Where the visitor's requests come from, for the audit log.")
    audit_log: Path | None = Field(default=None, description="The server's audit log; absent: there is none.")
