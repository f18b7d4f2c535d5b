"""Places in which the `robot.yaml` of a robot application is looked for; nothing of the application is imported."""

import importlib.util
from pathlib import Path
from typing import NamedTuple

from ....schemas.runs.plan import ApplicationPlan
from ....schemas.runs.policies import parse_policy

ROBOT_VARIABLE = "ROBOMAKER_ROBOT"
"""Name of the launch variable that names a job's robot."""

BUILT_IN_PACKAGE = f"{__name__.rsplit('.', 2)[0]}.applications"
"""Package of the applications that come along."""


class Package(NamedTuple):
    """Folders of a robot application in which its `robot.yaml` is searched, the innermost first, and their root."""

    folders: list[Path]
    """Folders of the application's packages, the innermost first."""

    root: Path
    """Folder that contains all files that the application may use."""

    def find(self, name: str) -> Path | None:
        """Returns the file of a name in the innermost folder that has it; `None` if none has."""
        return next((folder / name for folder in self.folders if (folder / name).is_file()), None)


def package_of(application: ApplicationPlan) -> Package | None:
    """Finds an application's files without importing it, as a failed import could not be attributed yet.

    Returns `None` if the application has no files of its own, or its package is not installed.
    """
    module = application.package or (application.attribute or "").rpartition(".")[0]
    parts = module.split(".") if module else []
    if application.policy is not None:  # the attribute is that of a built-in factory
        parts = parse_policy(application.policy).folders
    if application.path is not None:
        return Package([*_inwards(application.path, parts)[::-1], application.path], application.path)
    if not parts or (application.attribute or "").startswith(f"{BUILT_IN_PACKAGE}."):
        return None
    try:
        found = importlib.util.find_spec(parts[0])
    except (ImportError, ValueError):
        return None
    for location in found.submodule_search_locations or () if found else ():
        folder = Path(location)
        return Package([*_inwards(folder, parts[1:])[::-1], folder], folder)
    return None


def _inwards(folder: Path, parts: list[str]) -> list[Path]:
    """Returns the folders on the way down from a folder by names, as far as they exist, the outermost first."""
    folders = []
    for part in parts:
        folder = folder / part
        if not folder.is_dir():
            break
        folders.append(folder)
    return folders
