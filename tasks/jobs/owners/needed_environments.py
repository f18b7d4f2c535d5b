"""The environment that a job needs: recorded with the order, compared before a takeover.

Only what decides how the job goes counts: import path and packages if it imports code of its user's, and the settings
that confine and place its simulations. Where catalog and store are does not: who sees the job has the same.
"""

import os
import re
import socket
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from ....schemas.job_owners import PYTHON_PATH, NeededEnvironment
from ....schemas.settings import Settings
from ...service.service import Service
from ...simulations.planning.job_contents import CurrentApplications, imported_packages, package_content

_SIMULATION = (
    *("sandbox", "sandbox_network", "sandbox_show", "nice", "max_job_disk_gb"),
    *("max_output_gb", "max_output_files"),
)
SETTINGS: Mapping[str, Sequence[str]] = {
    "CreateSimulationJob": _SIMULATION,
    "StartSimulationJobBatch": (*_SIMULATION, "backend"),
    "CreateWorldGenerationJob": ("max_worlds_per_job",),
}
"""The settings that decide how jobs go, by the operation that orders them."""

OTHER_VARIABLES = ("ROBOMAKER_CONTAINER_ENGINE", "MENAGERIE_ROOT")
"""Variables of simulations that are no settings."""

_OF_PREFECT_RUN = re.compile(r"tmp\w+prefect|prefect-flow-run-\w+")
"""Names that `tempfile` makes of the suffix that Prefect's workers give it, and of the prefix that `prefect flow-run
execute` does, which containers of work pools run."""


def environment_needed(operation: str, request: Mapping[str, Any], service: Service) -> NeededEnvironment:
    """The part of this process's environment that a job ordered now needs.

    Args:
        operation: the operation that orders it.
        request: the request's members.
        service: where its applications are, and the settings that hold.
    """
    requests = _simulations(operation, request)
    packages = imported_packages(requests, CurrentApplications(service))
    names = list(SETTINGS.get(operation, ()))
    if any(each.get("iamRole") for each in requests):
        names.append("roles_file")
    variables = {variable(name): written(getattr(service.settings, name)) for name in names}
    if requests:
        variables |= {name: os.environ.get(name, "") for name in OTHER_VARIABLES}
    return NeededEnvironment(
        machine=socket.gethostname(),
        python=sys.prefix,
        python_path=None if packages is None else python_path(os.environ),
        variables=variables,
        packages=packages or {},
    )


def environment_here(needed: NeededEnvironment, settings: Settings, environ: Mapping[str, str]) -> NeededEnvironment:
    """The part of this process's environment that a job needs.

    Args:
        needed: what the job needs.
        settings: of this process.
        environ: its environment variables.
    """
    settings_of = {variable(name): name for name in type(settings).model_fields}
    variables = {
        name: written(getattr(settings, settings_of[name])) if name in settings_of else environ.get(name, "")
        for name in needed.variables
    }
    return NeededEnvironment(
        machine=socket.gethostname(),
        python=sys.prefix,
        python_path=python_path(environ),
        variables=variables,
        packages={name: package_content(name) for name in needed.packages},
    )


def _simulations(operation: str, request: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The requests of simulations in a request."""
    if operation == "StartSimulationJobBatch":
        return list(request.get("createSimulationJobRequests") or ())
    return [request] if operation == "CreateSimulationJob" else []


def variable(setting: str) -> str:
    """The environment variable of a setting."""
    return f"ROBOMAKER_{setting.upper()}"


def written(value: object) -> str:
    """A setting as its variable is written; nothing: the variable is not set."""
    if value is None:
        return ""
    return os.pathsep.join(map(str, cast("tuple[object, ...]", value))) if isinstance(value, tuple) else str(value)


def python_path(environ: Mapping[str, str]) -> tuple[str, ...]:
    """The folders of PYTHONPATH, absolute, without the one that Prefect makes for each run and removes.

    No other run has that folder. What a run imported from it is a package, and missed as such.
    """
    folders = (Path(path).absolute() for path in environ.get(PYTHON_PATH, "").split(os.pathsep) if path)
    return tuple(str(folder) for folder in folders if not _OF_PREFECT_RUN.fullmatch(folder.name))
