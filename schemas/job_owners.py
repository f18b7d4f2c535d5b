"""The process that runs a job (its owner), and the environment that another process needs to take the job over."""

import os
import shlex
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Literal

from pydantic import Field

from .wire.base import Model, optional

PYTHON_PATH = "PYTHONPATH"
NOT_INSTALLED = ""
"""Content of a package that is not installed."""

OwnerState = Literal["works", "died", "left", "ended"]
"""State of a job's owner: it works; it died, so that another process may take the job over; it gave the job back before
its end; or the job has ended.
"""


class JobOwner(Model):
    """The process that runs a simulation job, or ran it last: machine, process id and program."""

    program: str = Field(
        description="Program of the process: `robomaker run`, `robomaker serve`, `a run of a Prefect worker`."
    )
    machine: str = Field(description="Host name of the process's machine.")
    process_id: int | None = Field(description="Process id on that machine; absent: unknown.")

    @classmethod
    def of_lease(cls, owner: str) -> "JobOwner":
        """Parses the name of a lease's owner, `machine:process:part:program`; earlier releases left out the program."""
        machine, process, _, program = (*owner.split(":", 3), "", "", "")[:4]
        return cls(
            program=program or "a job worker", machine=machine, process_id=int(process) if process.isdecimal() else None
        )

    def __str__(self) -> str:
        where = f"process {self.process_id} on {self.machine}" if self.process_id is not None else f"on {self.machine}"
        return f"{self.program} ({where})"


class NeededEnvironment(Model):
    """Environment of the process that ordered a job for itself: machine, Python, variables and packages.

    Another process can continue the job only in the same environment.
    """

    machine: str = Field(description="Host name of the machine on which the job was ordered.")
    python: str = Field(description="Folder of the Python environment in which the job was ordered.")
    python_path: tuple[str, ...] | None = optional("Folders in PYTHONPATH; absent: the job imports no code of its own.")
    variables: dict[str, str] = Field(description="RoboMaker's environment variables with their values, set or not.")
    packages: dict[str, str] = Field(description="Installed packages of the job's applications, with content hashes.")

    @classmethod
    def of_stored(cls, stored: Mapping[str, Any]) -> "NeededEnvironment":
        """Reads a job's needed environment from the catalog's JSON."""
        return cls.model_validate(stored, strict=False)

    def differences(self, here: "NeededEnvironment") -> list[str]:
        """Describes in words how another process's environment differs from the one that the job needs.

        Args:
            here: Environment of the other process.
        """
        found = [
            f"{name} is {here.variables.get(name, '') or 'not set'}, not {value or 'unset'}"
            for name, value in self.variables.items()
            if here.variables.get(name, "") != value
        ]
        if self.python_path is not None and self.python_path != here.python_path:
            has, needs = (os.pathsep.join(paths or ()) or "not set" for paths in (here.python_path, self.python_path))
            found.insert(0, f"{PYTHON_PATH} is {has}, not {needs}")
        for name, content in self.packages.items():
            if (there := here.packages.get(name, NOT_INSTALLED)) != content:
                is_missing = there == NOT_INSTALLED
                found.append(f"package {name} {'is not installed' if is_missing else 'has other files'}")
        return found

    def command(self, arn: str, here: "NeededEnvironment | None" = None) -> str:
        """Returns the shell command that runs the job on its machine in the environment it was ordered in.

        Args:
            arn: ARN of the job.
            here: Environment of the user's process, whose equal parts need not be in the command; `None`: unknown.
        """
        here = here or NeededEnvironment(machine="", python="", variables={}, packages={})
        words: list[str] = []
        if self.python_path and self.python_path != here.python_path:
            words.append(f"{PYTHON_PATH}={shlex.quote(os.pathsep.join(self.python_path))}")
        words += [
            f"{name}={shlex.quote(value)}"
            for name, value in self.variables.items()
            if here.variables.get(name, "") != value
        ]
        program = "robomaker" if self.python == here.python else shlex.quote(f"{self.python}/bin/robomaker")
        return " ".join([*words, program, "perform", arn])


class JobStanding(Model):
    """State of the process that runs a simulation job, and who continues the job if that process has died."""

    owner: JobOwner = Field(description="Process that runs the job, or ran it last.")
    since: datetime | None = Field(description="Time at which the owner took the job.")
    state: OwnerState = Field(
        description="State of the owner: works, has died, has given the job back, or the job has ended."
    )
    lost: JobOwner | None = optional("Earlier owner, which died; absent: there was none.")
    differences: tuple[str, ...] = Field(
        default=(),
        description=(
            "Differences between this process's environment and the one that the job needs, as text; empty: none."
        ),
    )
    command: str | None = optional("Command that runs the job in its environment; absent: any job worker can run it.")
    machine: str | None = optional("Machine on which to run the command.")

    @property
    def waits_for_command(self) -> bool:
        """Whether the job continues only when a person runs a command."""
        return self.state in ("died", "left") and self.command is not None and bool(self.differences)

    def in_words(self) -> str:
        """Describes in a sentence or two which process runs the job and how it continues.

        An example: `carried out by OWNER since 2026-11-27 02:00:00 UTC, which has died; the next job worker takes it`.
        """
        since = f" since {self.since:%Y-%m-%d %H:%M:%S} UTC" if self.since else ""
        before = f", as {self.lost} had died" if self.lost else ""
        told = f"carried out by {self.owner}{since}{before}"
        if self.state in ("works", "ended"):
            return told
        told += ", which has died" if self.state == "died" else ", which has left it"
        if not self.waits_for_command:
            return f"{told}; the next job worker takes it"
        return f"{told}; job workers with another environment leave it: {'; '.join(self.differences)}"
