"""Reads the MJCF or URDF of a robot, with files of its own folder only.

A robot that needs files from elsewhere works on the machine where they are and nowhere else; so that is said before
anything runs.
"""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import mujoco

from .problems import invalid
from .urdf import rewrite_urdf

_TEXTURE_TAGS = frozenset({"texture"})
_MODEL_TAGS = frozenset({"include", "model"})
_File = tuple[str, Path]
"""A file as it is named, and where it is."""


def load_model(path: Path, root: Path) -> mujoco.MjSpec:
    """Reads a model file.

    Args:
        path: the MJCF or URDF.
        root: folder that it and all files it names have to be in.

    Raises:
        LaunchError: it is no model, or names files outside the folder.
    """
    check_inside(path, path, root, str(path))
    if not path.is_file():
        raise invalid(path, "there is no such file; give the robot's MJCF or URDF, relative to the mapping file")
    element = _parse(path)
    try:
        if element.tag == "robot":
            return mujoco.MjSpec.from_string(rewrite_urdf(element, path, root))
        for name, file in _files_of(element, path, path.parent):
            check_inside(path, file, root, name)
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as cause:
        raise invalid(path, f"MuJoCo cannot read it: {' '.join(str(cause).split())}") from cause


def check_inside(mentioned_in: Path, file: Path, root: Path, name: str) -> None:
    """Refuses files that are not in the robot's folder, links followed.

    Raises:
        LaunchError: it is elsewhere.
    """
    if not file.resolve().is_relative_to(root.resolve()):
        raise invalid(mentioned_in, f"the file {name!r} is outside of {root}; put it into the robot's own folder")


def _parse(path: Path) -> ET.Element:
    try:
        return ET.parse(path).getroot()  # noqa: S314 the robot's own code runs in this process as well
    except (ET.ParseError, UnicodeDecodeError, OSError) as cause:
        raise invalid(path, f"it is no XML: {cause}") from cause


def _files_of(element: ET.Element, path: Path, folder: Path, seen: frozenset[Path] = frozenset()) -> Iterator[_File]:
    """Every file that an MJCF names, with those of what it includes; relative names are the main file's."""
    compilers = list(element.iter("compiler"))
    meshes, textures = (
        next((each.get(key) or each.get("assetdir") for each in compilers if each.get(key) or each.get("assetdir")), "")
        for key in ("meshdir", "texturedir")
    )
    for each in element.iter():
        for key, name in each.attrib.items():
            if not key.startswith("file") or not name:
                continue
            if Path(name).is_absolute() or name.startswith("~"):
                raise invalid(path, f"the file {name!r} is absolute; files are relative to the model")
            inside = "" if each.tag in _MODEL_TAGS else textures if each.tag in _TEXTURE_TAGS else meshes
            file = folder / str(inside) / name
            yield name, file
            if each.tag in _MODEL_TAGS and file.suffix == ".xml" and file.is_file():
                if file.resolve() in seen:
                    raise invalid(path, f"the file {name!r} includes itself")
                within = seen | {file.resolve()}
                yield from _files_of(_parse(file), file, folder if each.tag == "include" else file.parent, within)
