"""Environment of a run's applications on this machine."""

import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ....schemas.runs.plan import ApplicationRole, RunPlan
from ....schemas.runs.programs import ProgramPlan
from ...service.service import Service
from .folders import Sandbox
from .process_variables import search_path

ROLES: tuple[ApplicationRole, ...] = ("simulation", "robot")


@dataclass(frozen=True)
class RunEnvironment:
    """Environment of a run's applications on this machine."""

    plan: RunPlan
    """The run, without its applications."""

    folder: Path
    """The run's own folder."""

    sandbox: Sandbox
    destinations: tuple[str, ...]
    """Folders of the job that data sources have put their data into."""

    service: Service
    stopped: Callable[[], bool] = lambda: False
    """Asked while something takes long whether to give up."""

    environ: Mapping[str, str] = field(default_factory=lambda: os.environ)

    def which(self, name: str) -> str | None:
        """Finds a program on the path of the job's processes."""
        return shutil.which(name, path=search_path(self.environ))


def application_configs(
    request: Mapping[str, Any], roles: Sequence[ApplicationRole] = ROLES
) -> Iterator[tuple[ApplicationRole, Mapping[str, Any]]]:
    """Yield the configured applications of a job's request, with their roles.

    Args:
        request: The job's.
        roles: The order of the roles.
    """
    for role in roles:
        for config in request.get(f"{role}Applications") or ():
            yield role, config


def run_sandbox(folder: Path) -> Sandbox:
    """The folders of a run's processes; `folder` is the run's own."""
    return Sandbox(folder / "root")


def container_sandbox(folder: Path, role: ApplicationRole) -> Sandbox:
    """The folders of an application that is a container: it shares none with the other application.

    Args:
        folder: the run's own folder.
        role: the application's.
    """
    return Sandbox(folder / f"{role}-root")


def tool_plan(
    role: ApplicationRole,
    tool: Mapping[str, Any],
    argv: list[str],
    folder: Path,
    environment: Mapping[str, str],
) -> ProgramPlan:
    """A tool of an application."""
    return ProgramPlan(
        name=f"{role}-{tool['name']}",
        role=role,
        kind="tool",
        argv=argv,
        folder=folder,
        environment=dict(environment),
        exit_behavior=tool.get("exitBehavior") or "RESTART",
    )
