"""Journal of the robot agent: its state in one JSON file that is written atomically, and survives a power loss."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .deployment import Order, deployment_of, version_of
from .errors import AgentError
from .state_machine import End, Phase, Probation, State

FORMAT = 1


def write_durably(path: Path, content: bytes, mode: int = 0o600) -> None:
    """Writes a file atomically, so that it survives a power loss.

    Raises:
        OSError: The file cannot be written; the disk may be full.
    """
    temporary = path.with_name(f".{path.name}.new")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except OSError:
        temporary.unlink()  # its bytes may be what the disk lacks
        raise
    temporary.replace(path)
    sync_folder(path.parent)


def sync_file(path: Path) -> None:
    """Makes a file and its name survive a power loss."""
    _sync(path, os.O_RDONLY)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Makes the names in a folder survive a power loss."""
    _sync(folder, os.O_RDONLY | os.O_DIRECTORY)


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class Journal:
    """Stores the agent's state in `journal.json`."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "journal.json"

    def load(self) -> State:
        """Reads the stored state; returns that of a new robot if there is none.

        Raises:
            AgentError: The file is not one of this agent.
        """
        try:
            content = json.loads(self._path.read_bytes())
        except FileNotFoundError:
            return State()
        except ValueError as error:
            raise AgentError(f"{self._path} is no JSON: {error}; enroll again with --again to begin anew") from None
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise AgentError(
                f"{self._path} has another format than {FORMAT}; use the agent that wrote it, or a newer one"
            )
        return _state(content)

    def save(self, state: State) -> None:
        """Stores a state durably.

        Raises:
            OSError: The state cannot be written; the state that was saved before remains.
        """
        content = {"format": FORMAT, **asdict(state), "phase": state.phase.value}
        write_durably(self._path, json.dumps(content, indent=1).encode())


def _state(content: Mapping[str, Any]) -> State:
    order, deployment, end, failure = (content.get(name) for name in ("order", "deployment", "end", "failure"))
    good, previous, probation = (content.get(name) for name in ("good", "previous", "probation"))
    return State(
        phase=Phase(content["phase"]),
        order=order and Order(**order),
        deployment=deployment and deployment_of(deployment),
        good=good and version_of(good),
        previous=previous and version_of(previous),
        failure=failure and (failure[0], failure[1]),
        end=end and _end(end),
        probation=probation and _probation(probation),
        restarts=content["restarts"],
        floors=content["floors"],
        newest_s=content["newest_s"],
        number=content.get("number", 0),
        trouble=content.get("trouble", ""),
    )


def _probation(content: Mapping[str, Any]) -> Probation:
    back = content["back"]
    return Probation(Order(**content["order"]), back and version_of(back), content["ends"])


def _end(content: Mapping[str, Any]) -> End:
    return End(**{**content, "order": Order(**content["order"]), "details": tuple(content["details"])})
