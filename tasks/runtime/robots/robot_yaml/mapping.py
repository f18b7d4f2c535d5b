"""`robot.yaml` as it is written: read, checked, found in MuJoCo Menagerie, with its errors."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path

from pydantic import ValidationError

from .....schemas.specs.text import MappingNode, child, key_place, parse, plain, value_place
from .....schemas.wire.errors import LaunchError, SpecError
from .....schemas.wire.request_problems import problems_of
from .shape import ROBOT_MODELS, RobotModel, robot_model_type

INVALID_ROBOT = "InvalidBundleRobotApplication"
"""Failure code of a job whose robot cannot be made from its files."""

_SHOWN_NAMES = 12


def invalid(where: object, message: str) -> LaunchError:
    """An error about a file of the robot, or a place in one."""
    return LaunchError(f"{where}: {message}", INVALID_ROBOT)


def alternatives(name: str, names: Iterable[str], what: str) -> str:
    """Suggests what to write instead of an unknown name: the nearest name, or all."""
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
    """An error about a member of a mapping that can be read, with the line and column where the member stands.

    Args:
        error: its message begins with the file's name and the member, as `invalid` writes it; others are as they were.
        path: the YAML file.
    """
    said = str(error).removeprefix(f"{path.name}: ")
    member = _MEMBER.match(said)
    if member is None or said == str(error):
        return error
    steps = tuple(int(step) if step.isdigit() else step for step in _STEP.findall(member[1]))
    place = value_place(parse(path.read_text(encoding="utf-8"), path.name), steps)
    return LaunchError(f"{place}: {said}", error.failure_code)


def read_mapping(path: Path) -> RobotModel:
    """Reads and checks a mapping file.

    Args:
        path: the YAML file.

    Raises:
        LaunchError: with everything that is wrong: file, line, member, value and what would be right.
    """
    try:
        root = parse(path.read_text(encoding="utf-8"), path.name)
    except (OSError, UnicodeDecodeError) as cause:
        raise invalid(path, f"it cannot be read: {cause}") from cause
    except SpecError as cause:
        raise LaunchError(str(cause), INVALID_ROBOT) from cause
    if not isinstance(root, MappingNode):
        raise invalid(path.name, "it has to be a mapping with version, model, base, footprint, spawn and drive")
    drive = root.entries.get("drive")
    kind = child(drive, "kind") if drive is not None else None
    kinds = ", ".join(ROBOT_MODELS)
    if isinstance(drive, MappingNode) and (kind is None or plain(kind) not in ROBOT_MODELS):
        place = key_place(root, ("drive", "kind")) if kind is not None else drive.place
        said = (
            "is missing" if kind is None else f"is {plain(kind)!r}; {alternatives(str(plain(kind)), ROBOT_MODELS, '')}"
        )
        raise invalid(place, f"drive.kind: {said}; there are {kinds}")
    document = plain(root)
    model = robot_model_type(document)
    try:
        return model.model_validate(document)
    except ValidationError as error:
        found = [
            ((key_place if each.about_key else value_place)(root, each.location), each)
            for each in problems_of(error, model)
        ]
        texts = [f"{place}: {each}" for place, each in sorted(found, key=lambda item: (item[0].line, item[0].column))]
        raise LaunchError("; ".join(texts), INVALID_ROBOT) from None


MENAGERIE = "menagerie:"
ROOT_VARIABLE = "MENAGERIE_ROOT"

_FREE_JOINT_NUMBERS = 7


def menagerie_root(variables: Mapping[str, str]) -> Path:
    """The checkout.

    Raises:
        LaunchError: it is not said where it is, or it is not there.
    """
    text = variables.get(ROOT_VARIABLE)
    clone = "git clone https://github.com/google-deepmind/mujoco_menagerie"
    if not text:
        raise LaunchError(
            f"{ROOT_VARIABLE} is not set; it has to be the folder of a checkout of MuJoCo Menagerie ({clone}), in the "
            "environment of the worker or in a launch configuration's environmentVariables"
        )
    root = Path(text)
    if not root.is_dir():
        raise LaunchError(f"{ROOT_VARIABLE}: there is no folder {text!r}; {clone}")
    return root


def menagerie_file(reference: str, root: Path) -> Path:
    """The model file that `menagerie:<model>/<file>` means.

    Raises:
        LaunchError: there is none.
    """
    name, _, file = reference.removeprefix(MENAGERIE).partition("/")
    folder = _folder(name, root)
    if not file or not (folder / file).is_file():
        there = _model_files(folder)
        raise LaunchError(f"{reference}: {name} has no file {file!r}; {alternatives(file, there, 'models')}")
    return folder / file


def menagerie_mapping(reference: str, root: Path) -> Path:
    """The mapping file of `menagerie:<model>`.

    Raises:
        LaunchError: there is no such model, or it has no mapping yet; the message has one to begin with.
    """
    name = reference.removeprefix(MENAGERIE)
    folder = _folder(name, root)
    mapping = folder / MAPPING_FILE
    if mapping.is_file():
        return mapping
    models = _model_files(folder)
    raise LaunchError(
        f"{reference}: {folder} has no {MAPPING_FILE}, which says how the robot stands and is driven (Menagerie has "
        f"none of its own). Write it there, or into a robot application with `model: {MENAGERIE}{name}/"
        f"{models[0] if models else 'file.xml'}`; docs/robots.md has all members. To begin with:\n"
        + _template(folder, models),
    )


def _folder(name: str, root: Path) -> Path:
    models = sorted(each.name for each in root.iterdir() if each.is_dir() and _model_files(each))
    if name not in models:
        raise LaunchError(f"{MENAGERIE}{name}: {root} {_lacks(name, models)}")
    return root / name


def _lacks(name: str, models: list[str]) -> str:
    return f"has no model {name!r}; {alternatives(name, models, 'models')}"


def _model_files(folder: Path) -> list[str]:
    """The models in a folder of Menagerie; `scene….xml` puts one on a floor."""
    names = sorted(each.name for each in folder.glob("*.xml"))
    return [name for name in names if not name.startswith("scene")]


def _template(folder: Path, models: list[str]) -> str:
    model = f"{folder.name.split('_')[-1]}.xml"
    model = model if model in models or not models else models[0]
    base, height_m, keyframe = _first_body(folder / model)
    return "\n".join(
        (
            "version: 1",
            f"model: {model}",
            f"base: {base}",
            "footprint: {radius_m: 0.4}  # measure it",
            f"spawn: {{height_m: {height_m:g}{f', keyframe: {keyframe}' if keyframe else ''}}}",
            "drive: {kind: actuators}  # or differential, or velocity",
            "sensors: {lidar: {height_m: 0.3}}",
        )
    )


def _first_body(path: Path) -> tuple[str, float, str]:
    """Name and height of a model's first body, and its first keyframe, as far as they can be read off."""
    try:
        root = ET.parse(path).getroot()  # noqa: S314 the robot's model is loaded next
        body, key = root.find("./worldbody/body"), root.find("./keyframe/key")
        name = body.get("name", "base") if body is not None else "base"
        place = body.get("pos", "0 0 0") if body is not None else "0 0 0"
        if key is not None and len(key.get("qpos", "").split()) >= _FREE_JOINT_NUMBERS:
            place = key.get("qpos", "")  # the first joint of what moves freely is the free one
        return name, float(place.split()[2]), key.get("name", "") if key is not None else ""
    except (ET.ParseError, OSError, ValueError, IndexError):
        return "base", 0.3, ""
