"""Reader of `robot.yaml`: parses and checks the file, with error messages."""

import re
from collections.abc import Collection, Iterable
from difflib import SequenceMatcher, get_close_matches
from pathlib import Path

from pydantic import ValidationError

from .....schemas.specs.yaml_nodes import MappingNode, child, key_place, parse, plain, value_place
from .....schemas.wire.errors import LaunchError, Problem, SpecError
from .....schemas.wire.request_problems import problems_of
from .shape import ROBOT_MODELS, RobotModel, robot_model_type

INVALID_ROBOT = "InvalidBundleRobotApplication"
"""Failure code of a job whose robot cannot be made from its files."""

_SHOWN_NAMES = 12
_COMPARED = 10
"""Number of similar names among which those with a word of the member are looked for."""
_AS_LIKE = 0.2
"""Difference of the likeness, 0 to 1, up to which a name is nearly as like as the most similar one."""
_WORD = re.compile("[a-z]{3,}")


def invalid(where: object, message: str) -> LaunchError:
    """Returns, without raising it, the `LaunchError` about a robot's file, or about a place in the file."""
    return LaunchError(f"{where}: {message}", INVALID_ROBOT)


def alternatives(name: str, names: Iterable[str], what: str, member: str = "") -> str:
    """Returns text that suggests the nearest known names instead of an unknown one, or lists known names.

    Of similar names the one goes first that has a word of the member, as `lidar_link` has for `sensors.lidar.at`.

    Args:
        name: The unknown name.
        names: The known ones; empty ones do not count.
        what: Plural noun for them, such as `bodies`.
        member: Member of `robot.yaml` that has the unknown name.
    """
    there: Collection[str] = [each for each in names if each]
    if near := _near(name, there, set(_WORD.findall(member))):
        return f"did you mean {' or '.join(map(repr, near))}?"
    shown = ", ".join(list(there)[:_SHOWN_NAMES])
    more = f" and {len(there) - _SHOWN_NAMES} more" if len(there) > _SHOWN_NAMES else ""
    return f"it has {what} {shown}{more}" if there else f"it has no {what}"


def _near(name: str, names: Collection[str], words: set[str]) -> list[str]:
    """Returns the name that is most like another; first, if there is one, a similar name that has one of some words."""
    alike = {each: SequenceMatcher(None, name, each).ratio() for each in get_close_matches(name, names, n=_COMPARED)}
    first = next(iter(alike), None)
    fits = [
        each
        for each in alike
        if words.intersection(_WORD.findall(each)) and alike[each] > alike[first or ""] - _AS_LIKE
    ]
    return list(dict.fromkeys([*fits[:1], *([first] if first else [])]))


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
