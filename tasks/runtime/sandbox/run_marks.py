"""Marks of runs: which process supervises which job, so that others on this machine know whose a process is.

All processes of a run descend from its supervisor, which adopts orphans. The mark is in the run's own folder, which its
processes do not see in a box, and goes with it; a supervisor that died leaves one that no process fits any more.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from pydantic import Field, ValidationError

from ....schemas.wire.base import Model
from ..limits.processes import process_state

_MARK = "supervisor.json"
_MOST_BYTES = 4096
_MOST_ANCESTORS = 1000
"""Processes above a process that are looked at; a machine's own are tens deep."""


class _Mark(Model):
    """Mark of a supervisor: its process and its job."""

    pid: int = Field(description="Its process.")
    started: int = Field(description="When that started, in ticks since the machine did: ids of processes come again.")
    job: str = Field(description="ARN of the job.")


def mark_run(folder: Path, job: str) -> None:
    """Notes that this process supervises a run.

    Args:
        folder: the run's own.
        job: ARN of the job.

    Raises:
        OSError: it cannot be written.
    """
    process = process_state(os.getpid())
    assert process is not None
    written = folder / f".{_MARK}"
    written.write_text(_Mark(pid=os.getpid(), started=process.started, job=job).model_dump_json())
    written.replace(folder / _MARK)


def marked_runs(home: Path) -> Mapping[int, str]:
    """The supervisors that live, by process, with the ARNs of their jobs.

    Args:
        home: the data home of the job workers.
    """
    found: dict[int, str] = {}
    for path in (home / "jobs").glob(f"*/*/{_MARK}"):
        with suppress(OSError, ValidationError):
            with path.open("rb") as file:
                mark = _Mark.model_validate_json(file.read(_MOST_BYTES))
            process = process_state(mark.pid)
            if process is not None and process.started == mark.started:
                found[mark.pid] = mark.job
    return found


def ancestors(pid: int) -> list[int] | None:
    """A process and those that it descends from, up to the first; `None` if one of them has ended meanwhile."""
    found = [pid]
    while len(found) < _MOST_ANCESTORS:
        process = process_state(found[-1])
        if process is None:
            return None
        if process.parent == 0:
            return found
        found.append(process.parent)
    return None
