"""Gazebo worlds in a ROS workspace or a simulation application's archive, and their start positions in launch files."""

import os
import re
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

from ...schemas.wire.errors import BundleError, ConfigurationError
from ..bundles.colcon import package_folders
from ..bundles.launch_files import MANIFEST, name_in
from ..service.service import Service
from ..simulations.inputs.bundles import unpack_colcon_bundle
from ..storage import unpack
from .launch_starts import LaunchFile, LaunchStart, find_start, is_read, read_launch_file

ARCHIVES = (".tar", ".tar.gz", ".tgz", ".zip")
"""File name suffixes of a ROS workspace's archives."""

_NOT_SOURCES = frozenset({"build", "log", "devel", "node_modules", "__pycache__"})
"""Folders of a workspace that contain only generated files, and no worlds of the user."""
_MOST_FILES = 500_000
_MOST_NAMED = 12
_MOST_BYTES = 20 * 1024 * 1024
"""Limit of a world file's size, in bytes."""
_WORLD_TAG = re.compile(rb"<world[\s>]")
_MODEL_PATH = re.compile(r"gazebo_model_path\s*=\s*[\"']([^\"']+)[\"']")


class _Place(NamedTuple):
    """ROS package of a file (empty if none), and the file's path in it."""

    package: str
    inside: str

    def whole(self) -> str:
        return f"{self.package}/{self.inside}" if self.package else self.inside


@dataclass(frozen=True, slots=True)
class WorkspaceWorld:
    """A Gazebo world file in a workspace."""

    name: str
    """Short name: the file name without suffix, with its package (or whole path) if several are called so."""
    place: str
    """Name of a world file's ROS package, and the file's path in it."""
    path: Path
    start: LaunchStart | None
    """Start pose in a world from a launch file; `None`: no launch file has one."""

    def is_called(self, name: str) -> bool:
        """Whether a name means this world.

        It does if it is the end of the world's path, or a file in its package; with the file's suffix or without.
        """
        calls = {self.name, self.place, f"{self.place.partition('/')[0]}/{self.path.name}"}
        calls |= {each.removesuffix(self.path.suffix) for each in calls}
        return any(f"/{each}".endswith(f"/{name}") for each in calls)


@dataclass(frozen=True, slots=True)
class Workspace:
    """Gazebo worlds and folders of models in a workspace or an unpacked bundle."""

    top: Path
    worlds: Sequence[WorkspaceWorld]
    model_paths: Sequence[Path]

    def world(self, name: str | None) -> WorkspaceWorld | None:
        """Returns the world of a name; without a name the only one, or `None` where there are several.

        Raises:
            ConfigurationError: The workspace has no world, or not exactly one of this name.
        """
        top = (self.top if self.top.name.strip(".") else self.top.resolve()).name or self.top
        names = [each.name for each in self.worlds]
        if not names:
            raise ConfigurationError(
                f"{top}: no file in it is a Gazebo world; files that end with .world or .sdf and have a "
                "<world> would be right"
            )
        if name is None:
            return self.worlds[0] if len(names) == 1 else None
        found = [each for each in self.worlds if each.name == name] or [
            each for each in self.worlds if each.is_called(name)
        ]
        if len(found) > 1:
            listed = ", ".join(each.name for each in found[:_MOST_NAMED])
            raise ConfigurationError(f"--world {name}: {top} has {len(found)} such worlds; name one: {listed}")
        if not found:
            near = get_close_matches(name.removesuffix(".world").removesuffix(".sdf"), names, n=1)
            hint = f"did you mean {near[0]}?" if near else f"it has {', '.join(names[:_MOST_NAMED])}"
            raise ConfigurationError(f"--world {name}: {top} has no such world; {hint}")
        return found[0]


def is_workspace(path: Path) -> bool:
    """Whether a path is a folder or has the name of an archive."""
    return path.is_dir() or path.name.lower().endswith(ARCHIVES)


@contextmanager
def opened_workspace(path: Path, service: Service) -> Iterator[Workspace]:
    """Reads a workspace's folder, or a bundle that is unpacked for as long as the block lasts.

    Args:
        path: The folder, or a bundle of `colcon bundle` or another archive.
        service: Service whose data home has the temporary folder.

    Raises:
        ConfigurationError: The folder or bundle does not exist, or is not an archive.
    """
    if path.is_dir():
        yield read_workspace(path)
        return
    if not path.is_file():
        raise ConfigurationError(f"{path}: it does not exist")
    with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
        folder = Path(scratch, path.name)
        try:
            unpack(path, folder)
            unpack_colcon_bundle(folder)
        except BundleError as error:
            raise ConfigurationError(f"{path}: {error}") from error
        yield read_workspace(folder)


def read_workspace(top: Path) -> Workspace:
    """Finds the Gazebo worlds in a folder, with their starts; launch files are read and never executed.

    Args:
        top: A workspace, a package, or an unpacked bundle; of a colcon bundle only packages are looked at, as the rest
            is an operating system.
    """
    files = list(_files(top))
    packages = [path.parent for path in files if path.name == MANIFEST]
    launch_files = [_launch_file(path, packages, top) for path in files if is_read(path)]
    found: dict[_Place, Path] = {}
    for path in files:
        if _is_world(path):
            found.setdefault(_place(path, packages, top), path)
    homes: dict[str, set[str]] = defaultdict(set)
    for place in found:
        homes[Path(place.inside).name].add(place.package)
    names = _names(list(found))
    worlds = [
        WorkspaceWorld(
            names[place],
            place.whole(),
            path,
            find_start(path.name, _launch_files_of(place.package, homes[path.name], launch_files)),
        )
        for place, path in found.items()
    ]
    paths = dict.fromkeys(path for package in packages for path in _model_paths(package, top))
    return Workspace(top, sorted(worlds, key=lambda each: each.name), list(paths))


def _files(top: Path) -> Iterator[Path]:
    count = 0
    for root in package_folders(top):
        for folder, inner, names in os.walk(root):
            # Sources come first: what was installed from them may be links.
            inner[:] = sorted(
                (each for each in inner if each not in _NOT_SOURCES and not each.startswith(".")),
                key=lambda each: (each != "src", each),
            )
            for name in sorted(names):
                count += 1
                if count > _MOST_FILES:
                    raise ConfigurationError(f"{top}: it has more than {_MOST_FILES:,} files; name a folder in it")
                yield Path(folder, name)


def _is_world(path: Path) -> bool:
    if path.suffix not in (".world", ".sdf"):
        return False
    try:
        return path.stat().st_size <= _MOST_BYTES and _WORLD_TAG.search(path.read_bytes()) is not None
    except OSError:
        return False


def _place(path: Path, packages: Sequence[Path], top: Path) -> _Place:
    """Returns a file's package and its path in it, equal for sources and files installed from them."""
    around = [package for package in packages if path.is_relative_to(package)]
    if not around:
        return _Place("", path.relative_to(top).as_posix())
    package = max(around, key=lambda each: len(each.parts))
    return _Place(name_in(package / MANIFEST) or package.name, path.relative_to(package).as_posix())


def _names(places: Sequence[_Place]) -> dict[_Place, str]:
    """Returns the shortest name of each world that no other world has."""
    names: dict[_Place, str] = {}
    for called in (_stem, _short, _Place.whole):
        counts = Counter(called(each) for each in places)
        names |= {each: called(each) for each in places if each not in names and counts[called(each)] == 1}
    return names


def _stem(place: _Place) -> str:
    return Path(place.inside).stem


def _short(place: _Place) -> str:
    return f"{place.package}/{_stem(place)}" if place.package else place.inside.removesuffix(Path(place.inside).suffix)


def _launch_file(path: Path, packages: Sequence[Path], top: Path) -> LaunchFile:
    place = _place(path, packages, top)
    return read_launch_file(path, place.package, place.whole())


def _launch_files_of(package: str, homes: Set[str], launch_files: Sequence[LaunchFile]) -> list[LaunchFile]:
    """Returns the launch files that may start a package's world, those of the package or that name it first.

    Args:
        package: The package.
        homes: All packages that have a world file of the same name. A launch file is for those that it names, else
            for the one that it is in, else for all.
        launch_files: All launch files.
    """
    own, others = [], []
    for file in launch_files:
        named = {home for home in homes if home and file.names_package(home)}
        meant = named or homes & {file.package} or homes
        if package in meant:
            (own if package in named or file.package == package else others).append(file)
    return own + others


def _model_paths(package: Path, top: Path) -> Iterator[Path]:
    """Yields the model folders that a package has or names, and the folder above it, if in the workspace."""
    named = []
    try:
        text = (package / MANIFEST).read_bytes()[:_MOST_BYTES].decode(errors="replace")
        for folders in _MODEL_PATH.findall(text):
            named += [Path(each.replace("${prefix}", str(package))) for each in folders.split(":") if each]
    except OSError:
        pass
    for path in (package / "models", *named, package.parent):
        if path.is_dir() and path.resolve().is_relative_to(top.resolve()):
            yield path
