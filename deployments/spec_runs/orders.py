"""Order of a run by a visitor: the specification, and the visitor's access key and address."""

from pathlib import Path

from pydantic import Field

from ...schemas.reports.run_record import RerunOf
from ...schemas.wire.base import Model


class Order(Model):
    """A run of a specification; the process that carries it out reads it from its standard input."""

    run_id: str = Field(description="Id of the run; its folder exists.")
    text: str = Field(description="The specification, which may hold secrets.")
    filename: str = Field(description="Name of the file in problems.")
    spec_path: str = Field(description="The file that the record names: that of the package, or the one in the folder.")
    command: list[str] = Field(description="The command that runs it again.")
    rerun_of: RerunOf | None = Field(default=None, description="Earlier run that runs again; absent: it is no rerun.")
    key_id: str | None = Field(default=None, description="Id of the visitor's access key; absent: none is asked for.")
    address: str | None = Field(default=None, description="Network address of the visitor, for the audit log.")
    audit_log: Path | None = Field(default=None, description="The server's audit log; absent: there is none.")
