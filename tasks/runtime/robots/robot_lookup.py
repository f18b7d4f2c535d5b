"""Finds the robot model of a job.

In this order:

1. `ROBOMAKER_ROBOT` in a launch configuration: `scout`, `walker`, `menagerie:<model>`, or a mapping file of the robot
   application (`robots/arm.yaml`);
2. `robot.yaml` in the robot application, in the innermost package on the way to its factory;
3. `walker` if that is the robot application;
4. Scout.
"""

import logging
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from ....schemas.runs.plan import ApplicationPlan
from ....schemas.wire.errors import LaunchError
from .mapping_places import BUILT_IN_PACKAGE, ROBOT_VARIABLE, Package, package_of
from .robot import Robot
from .robot_yaml.assembly import make_robot
from .robot_yaml.derived import said_of
from .robot_yaml.mapping import MAPPING_FILE, alternatives, invalid, placed, read_mapping
from .robot_yaml.menagerie import MENAGERIE, menagerie_file, menagerie_mapping
from .robot_yaml.model import RobotFiles
from .robot_yaml.shape import RobotModel
from .scout import SCOUT
from .walker import WALKER

BUILT_IN: Mapping[str, Robot] = {"scout": SCOUT, "walker": WALKER}

_logger = logging.getLogger(__name__)
_MAX_NAME = 60


class FoundRobot(NamedTuple):
    """The robot model of a job, and the reason why it is that one, as text."""

    robot: Robot
    why: str
    """Reason for the choice, as part of a sentence: `as ROBOMAKER_ROBOT says`."""

    def __str__(self) -> str:
        """Describes robot and reason in one line: `Robot: scout, as ROBOMAKER_ROBOT says.`."""
        return f"Robot: {self.robot.name}, {self.why}."


def find_robot(
    application: ApplicationPlan | None, variables: Mapping[str, str], *, is_container: bool = False
) -> FoundRobot:
    """Finds the robot model of a simulation job, and returns it with the reason for the choice.

    Takes the robot that a variable names, else the application's own; without either, the built-in robot Scout.

    Args:
        application: Robot application of the job, if it names one.
        variables: Environment variables of the launch configurations, and of the process.
        is_container: Whether the robot application is a container, to give the reason.

    Raises:
        LaunchError: The robot that is meant does not exist, or cannot be made.
    """
    named = variables.get(ROBOT_VARIABLE)
    if named is not None:
        return FoundRobot(_named_robot(named, application, variables), f"as {ROBOT_VARIABLE} says ({named})")
    if application is None:
        return FoundRobot(SCOUT, "since there is no robot application")
    package = package_of(application)
    if package is not None and (file := package.find(MAPPING_FILE)) is not None:
        robot = _from_file(file, package.root, variables, application)
        where = file.relative_to(package.root).as_posix()
        return FoundRobot(robot, f"from {where} of the robot application {application.name}")
    module = (application.attribute or "").removeprefix(f"{BUILT_IN_PACKAGE}.").split(".")[0]
    if application.policy is not None and application.path is None:
        module = application.name  # the attribute is that of the policy's factory
    if module in BUILT_IN:
        return FoundRobot(BUILT_IN[module], f"which the robot application {application.name} drives")
    return FoundRobot(SCOUT, f"since {_why_it_has_none(application, package, is_container)}")


def _why_it_has_none(application: ApplicationPlan, package: Package | None, is_container: bool) -> str:
    """Returns the reason why a robot application has no robot model, as text with the file that was probably meant."""
    owner = f"the robot application {application.name}"
    if package is None:
        if is_container:
            return f"{owner} is a container"
        # A rerun from recorded actions may lack the archive of the program, or be that of a container.
        has_files = application.attribute is not None or application.package is not None
        return f"{owner} has no {MAPPING_FILE if has_files else 'files here'}"
    places = [f"{folder.relative_to(package.root).as_posix()}/" for folder in package.folders[:-1]]
    found = next(
        (file for depth in ("*", "*/*") for file in sorted(package.root.glob(f"{depth}/{MAPPING_FILE}"))), None
    )
    hint = f" (but {found.relative_to(package.root).as_posix()}, which {ROBOT_VARIABLE} may name)" if found else ""
    return f"{owner} has no {MAPPING_FILE} in {', '.join([*places, 'its top folder'])}{hint}"


def _named_robot(named: str, application: ApplicationPlan | None, variables: Mapping[str, str]) -> Robot:
    if named in BUILT_IN:
        return BUILT_IN[named]
    if named.startswith(MENAGERIE):
        file, derived = menagerie_mapping(named, variables)
        name = named.removeprefix(MENAGERIE)
        if derived is None:
            return _from_file(file.path, file.root, variables, default_name=name)
        _logger.info("%s: %s", named, said_of(derived))
        return make_robot(derived, _files(derived, file.path, file.root, variables), _short_name(name))
    if not named.endswith((".yaml", ".yml")):
        known = [*BUILT_IN, f"{MENAGERIE}<model>"]
        hint = alternatives(named, BUILT_IN, "robots")
        raise LaunchError(
            f"{ROBOT_VARIABLE}: there is no robot {named!r}; {hint} Known are {', '.join(known)}, and mapping files of "
            "the robot application, such as robots/arm.yaml"
        )
    if Path(named).is_absolute() or ".." in Path(named).parts:
        raise LaunchError(f"{ROBOT_VARIABLE}: {named!r} is outside of the robot application; give a path within it")
    package = package_of(application) if application is not None else None
    if package is not None and (file := package.find(named)) is not None:
        return _from_file(file, package.root, variables, application)
    name = application.name if application else "scout"
    hint = "" if package is not None else "; files are looked for in bundles and installed packages, not in containers"
    raise LaunchError(f"{ROBOT_VARIABLE}: the robot application {name} has no file {named!r}{hint}")


def _from_file(
    path: Path,
    root: Path,
    variables: Mapping[str, str],
    application: ApplicationPlan | None = None,
    default_name: str | None = None,
) -> Robot:
    mapping = read_mapping(path)
    # The folder that a bundle was unpacked into has a name of the cache's.
    is_top = application is not None and path.parent == application.path
    folder = application.name if application is not None and is_top else path.parent.name
    name = _short_name(default_name or (folder if path.name == MAPPING_FILE else path.stem))
    try:
        return make_robot(mapping, _files(mapping, path, root, variables), name)
    except LaunchError as error:
        raise placed(error, path) from error


def _files(mapping: RobotModel, path: Path, root: Path, variables: Mapping[str, str]) -> RobotFiles:
    if mapping.model.startswith(MENAGERIE):
        model = menagerie_file(mapping.model, variables)
        return RobotFiles(path, model.path, model.root)
    if Path(mapping.model).is_absolute() or ".." in Path(mapping.model).parts:
        raise invalid(path.name, f"model: {mapping.model!r}; it has to be a path within the folder of {path.name}")
    return RobotFiles(path, path.parent / mapping.model, root)


def _short_name(text: str) -> str:
    """Returns a valid short name for a robot that has none, made from a text."""
    name = re.sub(r"[^a-z0-9_]+", "_", text.lower()).strip("_")
    name = name if re.match("[a-z]", name) else f"robot_{name}"
    return name[:_MAX_NAME].strip("_")
