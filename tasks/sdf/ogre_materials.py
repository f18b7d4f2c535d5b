"""Reads colours and textures of materials in OGRE scripts; Gazebo's own colour names are built in."""

import re
from pathlib import Path

from .lookup import Lookup
from .sdf_types import Material, Rgba, SdfError
from .xml_files import read_bytes

_MOST_SCRIPT_BYTES = 4 * 1024 * 1024
_MOST_SCRIPTS = 200
"""Limit of the material scripts of one folder that are read."""

_TOKEN = re.compile(r"^\s*material\s+([^\s:{]+)[^{]*\{", re.MULTILINE)
_DIFFUSE = re.compile(r"\bdiffuse\s+([\d.eE+-]+)\s+([\d.eE+-]+)\s+([\d.eE+-]+)(?:\s+([\d.eE+-]+))?")
_AMBIENT = re.compile(r"\bambient\s+([\d.eE+-]+)\s+([\d.eE+-]+)\s+([\d.eE+-]+)(?:\s+([\d.eE+-]+))?")
_TEXTURE = re.compile(r"\btexture\s+(\S+\.(?:png|jpg|jpeg|bmp|tga|tif|tiff))", re.IGNORECASE)

GAZEBO_COLORS: dict[str, Rgba] = {
    "Gazebo/Red": (1, 0, 0, 1), "Gazebo/Green": (0, 1, 0, 1), "Gazebo/Blue": (0, 0, 1, 1),
    "Gazebo/White": (1, 1, 1, 1), "Gazebo/Black": (0, 0, 0, 1), "Gazebo/FlatBlack": (0.1, 0.1, 0.1, 1),
    "Gazebo/Grey": (0.7, 0.7, 0.7, 1), "Gazebo/Gray": (0.7, 0.7, 0.7, 1), "Gazebo/DarkGrey": (0.175, 0.175, 0.175, 1),
    "Gazebo/DarkGray": (0.175, 0.175, 0.175, 1), "Gazebo/Yellow": (1, 1, 0, 1), "Gazebo/Orange": (1, 0.5, 0.06, 1),
    "Gazebo/Purple": (1, 0, 1, 1), "Gazebo/Turquoise": (0, 1, 1, 1), "Gazebo/Indigo": (0.33, 0, 0.5, 1),
    "Gazebo/Gold": (0.8, 0.65, 0.1, 1), "Gazebo/DarkYellow": (0.7, 0.7, 0, 1),
    "Gazebo/DarkMagentaTransparent": (0.7, 0, 0.7, 0.6), "Gazebo/Wood": (0.62, 0.45, 0.28, 1),
    "Gazebo/WoodFloor": (0.62, 0.45, 0.28, 1), "Gazebo/WoodPallet": (0.6, 0.45, 0.3, 1),
    "Gazebo/CeilingTiled": (0.9, 0.9, 0.88, 1), "Gazebo/Bricks": (0.6, 0.35, 0.28, 1),
    "Gazebo/Road": (0.3, 0.3, 0.3, 1), "Gazebo/Residential": (0.6, 0.58, 0.55, 1),
    "Gazebo/Grass": (0.3, 0.5, 0.2, 1), "Gazebo/SkyBlue": (0.13, 0.44, 0.7, 1),
    "Gazebo/PaintedWall": (0.9, 0.9, 0.85, 1),
    "Gazebo/LightWood": (0.75, 0.6, 0.4, 1), "Gazebo/ZincYellow": (0.97, 0.96, 0.2, 1),
}  # fmt: skip
"""Colours of Gazebo's own material scripts, which worlds do not bring; textures are replaced by their mean colour."""


class OgreMaterials:
    """Reads OGRE material scripts of an SDF world, each once.

    Args:
        lookup: Finds files.
    """

    def __init__(self, lookup: Lookup) -> None:
        self._lookup = lookup
        self._read: dict[Path, dict[str, tuple[str, Path]]] = {}

    def find(self, name: str, uris: list[str], base: Path) -> Material | None:
        """Finds a material by name in OGRE scripts.

        Args:
            name: Name of the material.
            uris: Scripts and folders that the file names.
            base: Folder that these are named from.
        """
        for uri in uris:
            for script in self._scripts(uri.strip(), base):
                if (found := self._materials(script).get(name)) is not None:
                    return self._material(*found)
        if name in GAZEBO_COLORS:
            return Material(GAZEBO_COLORS[name], None, True)
        return None

    def _scripts(self, uri: str, base: Path) -> list[Path]:
        if (file := self._lookup.file(uri, base)) is not None:
            return [file]
        folder = self._lookup.folder(uri, base)
        return sorted(folder.glob("*.material"))[:_MOST_SCRIPTS] if folder is not None else []

    def _materials(self, script: Path) -> dict[str, tuple[str, Path]]:
        if script not in self._read:
            try:
                text = read_bytes(script, _MOST_SCRIPT_BYTES).decode("utf-8", "replace")
            except SdfError:
                text = ""
            text = re.sub(r"//[^\n]*", "", text)
            starts = list(_TOKEN.finditer(text))
            ends = [start.start() for start in starts[1:]] + [len(text)]
            self._read[script] = {
                start[1].strip('"'): (text[start.end() : end], script) for start, end in zip(starts, ends, strict=True)
            }
        return self._read[script]

    def _material(self, body: str, script: Path) -> Material:
        said = _DIFFUSE.search(body) or _AMBIENT.search(body)
        color: Rgba = (1.0, 1.0, 1.0, 1.0)
        if said:
            try:
                red, green, blue = (min(max(float(part), 0.0), 1.0) for part in said.groups()[:3])
                color = red, green, blue, min(max(float(said[4] or 1.0), 0.0), 1.0)
            except ValueError:
                pass  # what is no number counts as white
        texture = _TEXTURE.search(body)
        if texture is None:
            return Material(color, None, True)
        names = (texture[1], f"../textures/{texture[1]}")
        found = next((path for name in names if (path := self._lookup.file(name, script.parent))), None)
        return Material((1.0, 1.0, 1.0, color[3]) if found else color, found, True)
