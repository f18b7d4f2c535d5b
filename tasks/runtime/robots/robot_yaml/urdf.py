"""Makes a URDF fit for MuJoCo's own importer.

The importer knows nothing of `package://`, leaves out what is only seen, merges fixed links into their parents and
reads no COLLADA files. So files get their places, and its settings are chosen such that all links keep their names.
"""

import logging
import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path

from .problems import invalid

_logger = logging.getLogger(__name__)

_MESHES = frozenset({".stl", ".obj", ".msh"})
_MOST_SHOWN = 1000  # characters of names in an error
_PACKAGE = "package://"
_SETTINGS = {"strippath": "false", "fusestatic": "false", "discardvisual": "false"}


def rewrite_urdf(robot: ET.Element, path: Path, root: Path) -> str:
    """Gives files their places and sets the importer's options that the file does not set itself.

    Args:
        robot: the document; changed in place.
        path: where it was read from.
        root: folder that all files have to be in.

    Returns:
        The text for MuJoCo.

    Raises:
        LaunchError: a file is missing, outside the folder, or of a form that MuJoCo does not read.
    """
    for link in robot.iter("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            for mesh in part.iter("mesh"):
                name = mesh.get("filename", "")
                if Path(name).suffix.lower() in _MESHES:
                    mesh.set("filename", str(_find(name, path, root)))
                elif part.tag == "visual":
                    _logger.warning("%s: %s is not shown: MuJoCo reads .stl, .obj and .msh meshes", path.name, name)
                    link.remove(part)
                    break
                else:
                    raise invalid(path, f"the mesh {name!r} cannot be read; MuJoCo reads .stl, .obj and .msh")
    extension = robot.find("mujoco")
    extension = ET.SubElement(robot, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ET.SubElement(extension, "compiler") if compiler is None else compiler
    for key, value in _SETTINGS.items():
        if key not in compiler.attrib:
            compiler.set(key, value)
    compiler.attrib.pop("meshdir", None)
    return ET.tostring(robot, encoding="unicode")


def _find(name: str, path: Path, root: Path) -> Path:
    """Finds a mesh file: `package://<package>/…` is in the folder of that name, or in the folder of `robot.yaml`."""
    if name.startswith(_PACKAGE):
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        places = [root / package / rest, *(folder / rest for folder in _folders_between(path.parent, root))]
    else:
        plain = name.removeprefix("file://")
        if Path(plain).is_absolute():
            raise invalid(path, f"the file {name!r} is absolute; write {_PACKAGE}<package>/… or a relative name")
        places = [path.parent / plain]
    for place in places:
        if not place.resolve().is_relative_to(root.resolve()):
            raise invalid(path, f"the file {name!r} is outside of {root}; put it into the robot's own folder")
        with suppress(OSError):  # a name that is too long
            if place.is_file():
                return place.resolve()
    raise invalid(path, f"there is no file {name!r}; looked for {', '.join(map(str, places))[:_MOST_SHOWN]}")


def _folders_between(folder: Path, root: Path) -> list[Path]:
    """The folder and those above it, up to the root."""
    folders = [folder, *folder.parents]
    return folders[: folders.index(root) + 1] if root in folders else [folder]
