"""Which robot a job drives.

In this order:

1. `ROBOMAKER_ROBOT` in a launch configuration: `scout`, `walker`, `menagerie:<model>`, or a mapping file of the robot
   application (`robots/arm.yaml`);
2. `robot.yaml` in the robot application, in the innermost package on the way to its factory;
3. `walker` if that is the robot application;
4. Scout.
"""

import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from .....schemas.errors import LaunchError
from .....schemas.robot_model import RobotModel
from .....schemas.simulation_run import ApplicationPlan
from ..robot_scout import SCOUT
from .mapped import make_robot
from .mapped_model import RobotFiles
from .mapping import MAPPING_FILE, read_mapping
from .menagerie import MENAGERIE, menagerie_file, menagerie_mapping, menagerie_root
from .problems import alternatives, invalid
from .robot import Robot
from .walker import WALKER

ROBOT_VARIABLE = "ROBOMAKER_ROBOT"

BUILT_IN: Mapping[str, Robot] = {"scout": SCOUT, "walker": WALKER}

_PACKAGE = __name__.rsplit(".", 2)[0]
_INVALID_INPUT = "InvalidInput"


class _Package(NamedTuple):
    """Where an application's files are."""

    folders: list[Path]
    """Its packages' folders, the innermost first."""

    root: Path
    """The folder that holds everything it may use."""


def find_robot(application: ApplicationPlan | None, variables: Mapping[str, str]) -> Robot:
    """The robot of a job.

    Args:
      application: its robot application, if it names one.
      variables: environment variables of the launch configurations, and of the process.

    Raises:
      LaunchError: the robot that is meant does not exist, or cannot be made.
    """
    named = variables.get(ROBOT_VARIABLE)
    if named is not None:
        return _named_robot(named, application, variables)
    if application is None:
        return SCOUT
    package = _package_of(application)
    if package is not None:
        for folder in package.folders:
            if (folder / MAPPING_FILE).is_file():
                return _from_file(folder / MAPPING_FILE, package.root, variables)
    module = (application.attribute or "").removeprefix(f"{_PACKAGE}.").split(".")[0]
    return BUILT_IN.get(module, SCOUT)


def _named_robot(named: str, application: ApplicationPlan | None, variables: Mapping[str, str]) -> Robot:
    if named in BUILT_IN:
        return BUILT_IN[named]
    if named.startswith(MENAGERIE):
        root = menagerie_root(variables)
        return _from_file(menagerie_mapping(named, root), root, variables)
    if not named.endswith((".yaml", ".yml")):
        known = [*BUILT_IN, f"{MENAGERIE}<model>"]
        hint = alternatives(named, BUILT_IN, "robots")
        raise LaunchError(
            f"{ROBOT_VARIABLE}: there is no robot {named!r}; {hint} Known are {', '.join(known)}, and mapping files of "
            "the robot application, such as robots/arm.yaml",
            _INVALID_INPUT,
        )
    if Path(named).is_absolute() or ".." in Path(named).parts:
        raise LaunchError(
            f"{ROBOT_VARIABLE}: {named!r} is outside of the robot application; give a path within it", _INVALID_INPUT
        )
    if application is not None and (package := _package_of(application)) is not None:
        for folder in package.folders:
            if (folder / named).is_file():
                return _from_file(folder / named, package.root, variables)
    name = application.name if application else "scout"
    raise LaunchError(f"{ROBOT_VARIABLE}: the robot application {name} has no file {named!r}", _INVALID_INPUT)


def _from_file(path: Path, root: Path, variables: Mapping[str, str]) -> Robot:
    mapping = read_mapping(path)
    return make_robot(mapping, _files(mapping, path, root, variables), _name_from(path))


def _files(mapping: RobotModel, path: Path, root: Path, variables: Mapping[str, str]) -> RobotFiles:
    if mapping.model.startswith(MENAGERIE):
        checkout = menagerie_root(variables)
        return RobotFiles(path, menagerie_file(mapping.model, checkout), checkout)
    if Path(mapping.model).is_absolute() or ".." in Path(mapping.model).parts:
        raise invalid(path.name, f"model: {mapping.model!r}; it has to be a path within the folder of {path.name}")
    return RobotFiles(path, path.parent / mapping.model, root)


def _name_from(path: Path) -> str:
    """A short name for a robot that has none: that of its folder, or of its file."""
    text = path.parent.name if path.name == MAPPING_FILE else path.stem
    return re.sub(r"[^a-z0-9_]+|^(?![a-z])", "_", text.lower()).strip("_") or "robot"


def _package_of(application: ApplicationPlan) -> _Package | None:
    """Where an application's files are, without importing any of them: whose fault that would be is not known yet."""
    parts = (application.attribute or "").split(".")[:-1]
    if application.path is not None:
        return _Package([*_inwards(application.path, parts)[::-1], application.path], application.path)
    if not parts or (application.attribute or "").startswith(f"{_PACKAGE}."):
        return None
    try:
        found = importlib.util.find_spec(parts[0])
    except (ImportError, ValueError):
        return None
    for location in found.submodule_search_locations or () if found else ():
        folder = Path(location)
        return _Package([*_inwards(folder, parts[1:])[::-1], folder], folder)
    return None


def _inwards(folder: Path, parts: list[str]) -> list[Path]:
    """Folders on the way down, as far as there are any."""
    folders = []
    for part in parts:
        folder = folder / part
        if not folder.is_dir():
            break
        folders.append(folder)
    return folders
