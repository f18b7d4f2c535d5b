"""Finds models and files that an SDF world names, on this machine; nothing is downloaded."""

import os
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlparse

from .sdf_types import SdfError
from .xml_files import read_xml

PATH_VARIABLES = ("GAZEBO_MODEL_PATH", "GAZEBO_RESOURCE_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH")
"""Environment variables with model folders, separated by colons."""

FUEL_VARIABLES = ("GZ_FUEL_CACHE_PATH", "IGN_FUEL_CACHE_PATH")
_FUEL_HOMES = (".gz/fuel", ".ignition/fuel")
_LEVELS_UP = 4
"""Number of folders above a world file in which its ROS package is searched."""
_MOST_LISTED = 20_000
"""Limit of the folders of a search path that are compared for similar names."""


class FoundModel(NamedTuple):
    """A Gazebo model's file, and the folder from which its other files are named."""

    file: Path
    folder: Path


class Lookup:
    """Finds models, meshes and textures that an SDF world file names.

    Args:
        world: The world file.
        given: Folders that the user names, which come first.
        environment: Environment variables.
    """

    def __init__(self, world: Path, given: Sequence[Path], environment: Mapping[str, str]) -> None:
        self._package = _package_of(world)
        self.folders = list(dict.fromkeys(_search_folders(world, self._package, given, environment)))
        """Folders in which Gazebo models and meshes are searched, in order."""
        self._fuel = _fuel_caches(environment)
        roots = dict.fromkeys(folder.resolve() for folder in (*self.folders, *self._fuel))
        self._roots = [folder for folder in roots if folder != folder.parent]

    def model(self, uri: str, base: Path) -> FoundModel | None:
        """Finds the newest description of a Gazebo model.

        Args:
            uri: URI in the file.
            base: Folder of the file that names it.

        Raises:
            SdfError: The `model.config`, or the file that it names, cannot be read.
        """
        found = self._find(uri, base)
        if found is None:
            return None
        return FoundModel(found, found.parent) if found.is_file() else _described(found)

    def file(self, uri: str, base: Path) -> Path | None:
        """Finds a mesh or texture file, by its exact name.

        Args:
            uri: URI in the file.
            base: Folder of the file that names it.
        """
        found = self._find(uri, base)
        return found if found is not None and found.is_file() else None

    def folder(self, uri: str, base: Path) -> Path | None:
        """Finds a folder that an SDF file names.

        Args:
            uri: URI in the file.
            base: Folder of the file that names it.
        """
        found = self._find(uri, base)
        return found if found is not None and found.is_dir() else None

    def similar(self, uri: str) -> list[str]:
        """Returns up to three existing Gazebo models with similar names."""
        wanted = next((part for part in reversed(_rest(uri).split("/")) if part), "")
        there: dict[str, str] = {}
        for folder in self.folders:
            for path in _listed(folder):
                there.setdefault(path.name.lower(), path.name)
        return [there[name] for name in get_close_matches(wanted.lower(), there, n=3, cutoff=0.7)]

    def _find(self, uri: str, base: Path) -> Path | None:
        try:
            candidates = list(self._candidates(uri.strip(), base))
        except ValueError:  # no address: http://[x
            return None
        for path in candidates:
            try:
                if "\0" not in str(path) and path.exists():
                    return self._inside(path)
            except OSError:  # a name longer than names may be
                continue
        return None

    def _inside(self, path: Path) -> Path | None:
        """Returns a file's path if it is inside a search path, else `None`: worlds must not read any other file."""
        resolved = path.resolve()
        return path if any(resolved.is_relative_to(root) for root in self._roots) else None

    def _candidates(self, uri: str, base: Path) -> Iterator[Path]:
        scheme = urlparse(uri).scheme if "://" in uri else ""
        rest = _rest(uri)
        if scheme in ("http", "https"):
            yield from self._fuel_folders(uri)
            return
        if scheme == "" and Path(rest).is_absolute():
            yield Path(rest)
            return
        if scheme == "file" and uri.startswith("file:///"):
            yield Path("/" + rest.lstrip("/"))
        rest = rest.lstrip("/")
        if scheme in ("", "file"):
            yield base / rest
            # Paths of pictures count from the mesh's folder or from the folder of textures beside it.
            yield base / "../materials/textures" / rest
            yield base / "materials/textures" / rest
        for folder in self.folders:
            yield folder / rest
        first, _, inner = rest.partition("/")
        if self._package is not None and first == self._package.name and inner:
            yield self._package / inner

    def _fuel_folders(self, uri: str) -> Iterator[Path]:
        """Yields folders in the caches of Gazebo Fuel for a model's address, the newest version first.

        They may be missing. There are none for an address that is not one of Fuel.
        """
        address = urlparse(uri)
        parts = [unquote(part) for part in address.path.split("/") if part]
        parts = parts[1:] if parts and parts[0].replace(".", "").isdecimal() else parts
        if len(parts) < 3 or ".." in parts:
            return
        owner, kind, name, *more = parts
        for cache in self._fuel:
            folder = cache / (address.hostname or "") / owner.lower() / kind / name.lower()
            if more and more[0].isdecimal():
                versions, more_inner = [folder / more[0]], more[1:]
            else:
                there = [each for each in _listed(folder) if each.name.isdecimal()]
                versions, more_inner = sorted(there, key=lambda each: int(each.name), reverse=True), more
            inner = more_inner[1:] if more_inner[:1] == ["files"] else more_inner
            yield from (version.joinpath(*inner) for version in versions)


def _rest(uri: str) -> str:
    return unquote(uri.partition("://")[2]) if "://" in uri else uri


def _package_of(world: Path) -> Path | None:
    """Returns the folder of the ROS package that a world is in; `None` if it is in none."""
    folders = list(world.resolve().parents)[:_LEVELS_UP]
    return next((folder for folder in folders if (folder / "package.xml").is_file()), None)


def _search_folders(
    world: Path, package: Path | None, given: Sequence[Path], environment: Mapping[str, str]
) -> Iterator[Path]:
    yield from given
    here = world.resolve().parent
    tops = [here, here.parent] if package is None else [here, here.parent, package]
    for top in tops:
        yield top
        yield top / "models"
    if package is not None:
        yield package.parent  # model://package/... names a file of a package
    for variable in PATH_VARIABLES:
        for folder in filter(None, environment.get(variable, "").split(":")):
            yield Path(folder)
            if variable == "GAZEBO_RESOURCE_PATH":
                yield Path(folder, "models")


def _fuel_caches(environment: Mapping[str, str]) -> list[Path]:
    named = [Path(environment[name]) for name in FUEL_VARIABLES if environment.get(name)]
    home = environment.get("HOME") or str(Path("~").expanduser())
    return [*named, *(Path(home, folder) for folder in _FUEL_HOMES)]


def _listed(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            return [Path(entry.path) for entry, _ in zip(entries, range(_MOST_LISTED), strict=False) if entry.is_dir()]
    except OSError:
        return []


def _described(folder: Path) -> FoundModel | None:
    """Finds the model file with the newest SDF version that a folder's `model.config` lists, else `model.sdf`.

    Returns None if the folder has no model file.
    """
    config = folder / "model.config"
    named: list[tuple[tuple[int, ...], str]] = []
    if config.is_file():
        try:
            for element in read_xml(config).iter("sdf"):
                version = tuple(int(part) for part in element.get("version", "0").split(".") if part.isdecimal())
                named.append((version, (element.text or "").strip()))
        except SdfError:
            named = []  # some public models have a model.config that is no XML; the file beside it is what counts
    for _, name in sorted(named, reverse=True):
        if name and (folder / name).is_file():
            return FoundModel(folder / name, folder)
    for name in ("model.sdf", "model-1_4.sdf"):
        if (folder / name).is_file():
            return FoundModel(folder / name, folder)
    return None
