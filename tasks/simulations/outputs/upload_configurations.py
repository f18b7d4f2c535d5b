"""Upload configurations of a job: which of its files are kept under which names, and when."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.globs import Glob
from ..environment.folders import HOME, Sandbox
from ..environment.run_environment import application_configs, container_sandbox, run_sandbox

ROLLING = "UPLOAD_ROLLING_AUTO_REMOVE"
AT_END = "UPLOAD_ON_TERMINATE"

_DEFAULTS: Mapping[str, str] = {
    "gazebo-logs": f"{HOME}/.gazebo/**",
    "ros-bags": f"{HOME}/.ros/bag/**",
    "ros-logs": f"{HOME}/.ros/log/**",
}
"""Names and globs of `useDefaultUploadConfigurations`."""


@dataclass(frozen=True)
class Upload:
    """One upload configuration, on this machine."""

    name: str
    """The folder of its files below the run's outputs."""

    glob: Glob
    is_rolling: bool
    sandbox: Sandbox
    """The folders that its application sees."""

    path: str = ""
    """The glob as it was given; empty: it is one of the defaults, which need not match anything."""


def uploads_of(request: Mapping[str, Any], folder: Path) -> list[Upload]:
    """The upload configurations of a job's applications.

    Args:
        request: the job's request.
        folder: the run's own folder.
    """
    return [
        Upload(each["name"], Glob(each["path"]), each["uploadBehavior"] == ROLLING, _sandbox(folder, role), asked)
        for role, config in application_configs(request)
        for each, asked in _configurations(config)
    ]


def _configurations(config: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], str]]:
    """An application's own configurations with their globs, and the default ones.

    Those are added to its own unless it says no, or are there alone if it says yes.
    """
    own = config.get("uploadConfigurations") or []
    yield from ((each, each["path"]) for each in own)
    if config.get("useDefaultUploadConfigurations", bool(own)):
        for name, path in _DEFAULTS.items():
            yield {"name": name, "path": path, "uploadBehavior": AT_END}, ""


def _sandbox(folder: Path, role: ApplicationRole) -> Sandbox:
    own = container_sandbox(folder, role)
    return own if own.root.is_dir() else run_sandbox(folder)
