"""Reader of `robot.yaml`: parses and checks the file, with error messages."""

import re
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path

from pydantic import ValidationError

from .....schemas.specs.yaml_nodes import MappingNode, child, key_place, parse, plain, value_place
from .....schemas.wire.errors import LaunchError, Problem, SpecError
from .....schemas.wire.request_problems import problems_of
from .shape import ROBOT_MODELS, RobotModel, robot_model_type

INVALID_ROBOT = "InvalidBundleRobotApplication"
"""Failure code of a job whose robot cannot be made from its files."""

_SHOWN_NAMES = 12


def invalid(where: object, message: str) -> LaunchError:
    """Returns, without raising it, the `LaunchError` about a robot's file, or about a place in the file."""
    return LaunchError(f"{where}: {message}", INVALID_ROBOT)


def alternatives(name: str, names: Iterable[str], what: str) -> str:
    """Returns text that suggests the nearest known name instead of an unknown one, or lists known names.

    Args:
        name: The unknown name.
        names: The known ones; empty ones do not count.
        what: Plural noun for them, such as `bodies`.
    """
    there: Collection[str] = [each for each in names if each]
    if near := get_close_matches(name, there, n=1):
        return f"did you mean {near[0]!r}?"
    shown = ", ".join(list(there)[:_SHOWN_NAMES])
    more = f" and {len(there) - _SHOWN_NAMES} more" if len(there) > _SHOWN_NAMES else ""
    return f"it has {what} {shown}{more}" if there else f"it has no {what}"


MAPPING_FILE = "robot.yaml"


_MEMBER = re.compile(r"([a-z]\w*(?:\.\w+|\[[0-9]+\])*): ")
_STEP = re.compile(r"\w+")


def placed(error: LaunchError, path: Path) -> LaunchError:
    """Returns an error about a member of `robot.yaml` with the member's line and column added.

    Args:
        error: Error whose message begins with the file's name and the member, as `invalid` writes it; other errors are
            returned unchanged.
        path: The YAML file.
    """
    said = str(error).removeprefix(f"{path.name}: ")
    member = _MEMBER.match(said)
    if member is None or said == str(error):
        return error
    steps = tuple(int(step) if step.isdigit() else step for step in _STEP.findall(member[1]))
    place = value_place(parse(path.read_text(encoding="utf-8"), path.name), steps)
    return LaunchError(f"{place}: {said}", error.failure_code)


def read_mapping(path: Path) -> RobotModel:
    """Reads and checks a `robot.yaml` file.

    Args:
        path: Path of `robot.yaml`.

    Raises:
        LaunchError: With everything that is wrong: file, line, member, value and what would be right.
    """
    mapping, problems = check_mapping(path)
    if mapping is None:
        raise LaunchError("; ".join(map(str, problems)), INVALID_ROBOT)
    return mapping


def check_mapping(path: Path) -> tuple[RobotModel | None, list[Problem]]:
    """Reads a `robot.yaml` file; returns what it says, or `None` and everything that is wrong.

    Args:
        path: Path of `robot.yaml`.

    Raises:
        LaunchError: The file cannot be read.
    """
    try:
        root = parse(path.read_text(encoding="utf-8"), path.name)
    except (OSError, UnicodeDecodeError) as cause:
        raise invalid(path, f"it cannot be read: {cause}") from cause
    except SpecError as cause:
        return None, cause.problems
    if not isinstance(root, MappingNode):
        words = "it has to be a mapping with version, model, base, footprint, spawn and drive"
        return None, [Problem(root.place, "", words)]
    drive = root.entries.get("drive")
    kind = child(drive, "kind") if drive is not None else None
    kinds = ", ".join(ROBOT_MODELS)
    if isinstance(drive, MappingNode) and (kind is None or plain(kind) not in ROBOT_MODELS):
        place = key_place(root, ("drive", "kind")) if kind is not None else drive.place
        said = (
            "is missing" if kind is None else f"is {plain(kind)!r}; {alternatives(str(plain(kind)), ROBOT_MODELS, '')}"
        )
        return None, [Problem(place, "drive.kind", f"{said}; there are {kinds}")]
    document = plain(root)
    model = robot_model_type(document)
    try:
        return model.model_validate(document), []
    except ValidationError as error:
        found = [
            Problem((key_place if each.about_key else value_place)(root, each.location), each.path, each.message)
            for each in problems_of(error, model)
        ]
        return None, sorted(found, key=lambda each: (each.place.line, each.place.column))
