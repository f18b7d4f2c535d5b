"""Robots of MuJoCo Menagerie, by their names: from a checkout, or from what the package `mujoco-menagerie` has fetched.

Nothing is fetched here: `mujoco-menagerie prefetch <name>` does that, once, when a person asks for it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .....schemas.extras import how_to_install
from .....schemas.wire.errors import LaunchError
from .mapping import MAPPING_FILE, alternatives

MENAGERIE = "menagerie:"
ROOT_VARIABLE = "MENAGERIE_ROOT"
CACHE_VARIABLE = "MENAGERIE_CACHE_DIR"

_EXTRA = "menagerie"
_CLONE = "git clone https://github.com/google-deepmind/mujoco_menagerie"
_FREE_JOINT_NUMBERS = 7
_MB = 1e6


@dataclass(frozen=True)
class MenagerieFile:
    """A file of a robot in MuJoCo Menagerie."""

    path: Path
    root: Path
    """Folder that all files of the robot have to be in."""


def menagerie_file(reference: str, variables: Mapping[str, str]) -> MenagerieFile:
    """Finds the model file that `menagerie:<model>/<file>` means.

    Args:
        reference: the text.
        variables: environment variables of the launch configurations, and of the process.

    Raises:
        LaunchError: there is none, or its model has not been fetched.
    """
    name, _, file = reference.removeprefix(MENAGERIE).partition("/")
    folder = _folder(name, variables)
    if not file or not (folder.path / file).is_file():
        there = _model_files(folder.path)
        raise LaunchError(f"{reference}: {name} has no file {file!r}; {alternatives(file, there, 'models')}")
    return MenagerieFile(folder.path / file, folder.root)


def menagerie_mapping(reference: str, variables: Mapping[str, str]) -> MenagerieFile:
    """Finds the `robot.yaml` of `menagerie:<model>`.

    Args:
        reference: the text.
        variables: environment variables of the launch configurations, and of the process.

    Raises:
        LaunchError: there is no such model, it has not been fetched, or has no mapping; then the message has one to
            begin with.
    """
    name = reference.removeprefix(MENAGERIE)
    folder = _folder(name, variables)
    mapping = folder.path / MAPPING_FILE
    if mapping.is_file():
        return MenagerieFile(mapping, folder.root)
    models = _model_files(folder.path)
    there = "" if folder.root == folder.path else "there, or "  # the package replaces its own folders
    raise LaunchError(
        f"{reference}: {folder.path} has no {MAPPING_FILE}, which says how the robot stands and is driven (Menagerie "
        f"has none of its own). Write it {there}into a robot application with `model: {MENAGERIE}{name}/"
        f"{models[0] if models else 'file.xml'}`; docs/robots.md has all members. To begin with:\n"
        + _template(folder.path, models),
    )


def _folder(name: str, variables: Mapping[str, str]) -> MenagerieFile:
    """The folder of a model."""
    return _in_checkout(name, variables[ROOT_VARIABLE]) if variables.get(ROOT_VARIABLE) else _fetched(name, variables)


def _in_checkout(name: str, text: str) -> MenagerieFile:
    root = Path(text)
    if not root.is_dir():
        raise LaunchError(f"{ROOT_VARIABLE}: there is no folder {text!r}; {_CLONE}")
    models = sorted(each.name for each in root.iterdir() if each.is_dir() and _model_files(each))
    if name not in models:
        raise LaunchError(f"{MENAGERIE}{name}: {root} has no model {name!r}; {alternatives(name, models, 'models')}")
    return MenagerieFile(root / name, root)


def _fetched(name: str, variables: Mapping[str, str]) -> MenagerieFile:
    try:
        import mujoco_menagerie  # an extra
    except ImportError:
        raise LaunchError(
            f"{MENAGERIE}{name}: the package mujoco-menagerie is not installed, and {ROOT_VARIABLE} is not set. Add "
            f"it ({how_to_install(_EXTRA)}) and fetch the model (mujoco-menagerie prefetch {name}); or make a checkout "
            f"({_CLONE}), and set {ROOT_VARIABLE} to its folder in the environment of the worker or in a launch "
            "configuration's environmentVariables"
        ) from None
    names = mujoco_menagerie.names()
    if name not in names:
        version = mujoco_menagerie.__version__
        hint = alternatives(name, names, "models")
        raise LaunchError(f"{MENAGERIE}{name}: mujoco-menagerie {version} has no model {name!r}; {hint}")
    robot, cache = mujoco_menagerie.get(name), mujoco_menagerie.Cache(variables.get(CACHE_VARIABLE))
    if not cache.is_cached(robot):
        size = f"{robot.download_size / _MB:.1f} MB, " if robot.download_size else ""
        raise LaunchError(
            f"{MENAGERIE}{name}: the model is not in {cache.dir}, and jobs fetch nothing by themselves; "
            f"`mujoco-menagerie prefetch {name}` does ({size}license {robot.license}), as the job worker's user. "
            f"{CACHE_VARIABLE} names another folder for both"
        )
    folder = cache.model_path(robot)
    return MenagerieFile(folder, folder)


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
