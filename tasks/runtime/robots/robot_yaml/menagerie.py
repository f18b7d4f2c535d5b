"""Robots of MuJoCo Menagerie by name: from a checkout, or from the cache of the package `mujoco-menagerie`.

Nothing is downloaded here: `mujoco-menagerie prefetch <name>` does that when a person asks for it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .....schemas.extras import how_to_install
from .....schemas.wire.errors import LaunchError
from .derived import derive_mapping
from .mapping import MAPPING_FILE, alternatives
from .shape import RobotModel

MENAGERIE = "menagerie:"
ROOT_VARIABLE = "MENAGERIE_ROOT"
CACHE_VARIABLE = "MENAGERIE_CACHE_DIR"

_EXTRA = "menagerie"
_CLONE = "git clone https://github.com/google-deepmind/mujoco_menagerie"
_MB = 1e6


@dataclass(frozen=True)
class MenagerieFile:
    """Path of a file of a robot in MuJoCo Menagerie, and the root below which all of the robot's files are."""

    path: Path
    root: Path
    """Folder that contains all files of the robot."""


def menagerie_file(reference: str, variables: Mapping[str, str]) -> MenagerieFile:
    """Finds the model file that `menagerie:<model>/<file>` means.

    Args:
        reference: Text of the form `menagerie:<model>/<file>`.
        variables: Environment variables of the launch configurations, and of the process.

    Raises:
        LaunchError: The model or file does not exist, or the model has not been downloaded.
    """
    name, _, file = reference.removeprefix(MENAGERIE).partition("/")
    folder = _folder(name, variables)
    if not file or not (folder.path / file).is_file():
        there = _model_files(folder.path)
        raise LaunchError(f"{reference}: {name} has no file {file!r}; {alternatives(file, there, 'models')}")
    return MenagerieFile(folder.path / file, folder.root)


def menagerie_mapping(reference: str, variables: Mapping[str, str]) -> tuple[MenagerieFile, RobotModel | None]:
    """Finds the `robot.yaml` of `menagerie:<model>`, or derives it from the model if there is none.

    Args:
        reference: Text of the form `menagerie:<model>`.
        variables: Environment variables of the launch configurations, and of the process.

    Returns:
        The file, and the mapping where it is derived; then the file is where one would be.

    Raises:
        LaunchError: The model does not exist, has not been downloaded, or does not say enough to derive a `robot.yaml`;
            then the message says what to write.
    """
    name = reference.removeprefix(MENAGERIE)
    folder = _folder(name, variables)
    mapping, models = folder.path / MAPPING_FILE, _model_files(folder.path)
    if mapping.is_file():
        return MenagerieFile(mapping, folder.root), None
    usual = f"{folder.path.name.split('_')[-1]}.xml"
    model = usual if usual in models or not models else models[0]
    derived = derive_mapping(folder.path / model) if models else "it has no model"
    if not isinstance(derived, str):
        return MenagerieFile(mapping, folder.root), derived
    there = "" if folder.root == folder.path else "there, or "  # the package replaces its own folders
    raise LaunchError(
        f"{reference}: {folder.path} has no {MAPPING_FILE}, which says how the robot stands and is driven, and {model} "
        f"does not tell: {derived}. Write it {there}into a robot application, with `model: {MENAGERIE}{name}/{model}`, "
        "base, footprint.radius_m, spawn.height_m and drive; docs/robots.md has all members"
    )


def _folder(name: str, variables: Mapping[str, str]) -> MenagerieFile:
    """Returns the place of a robot model of MuJoCo Menagerie: in the checkout that a variable names, or downloaded.

    Raises LaunchError if there is no such model, or if it cannot be downloaded.
    """
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
    """Lists the model files in a folder of Menagerie, without `scene….xml`, which put a model on a floor."""
    names = sorted(each.name for each in folder.glob("*.xml"))
    return [name for name in names if not name.startswith("scene")]
