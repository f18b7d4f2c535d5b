"""Files that a robot's model names: finds them, and suggests similar names for missing ones."""

import unicodedata
from collections.abc import Iterator
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import unquote

from .mapping import invalid

_MOST_SHOWN = 1000  # characters of names in an error
_PACKAGE = "package://"
_MODEL = "model://"
"""Prefix of a model's files in Gazebo; in URDF it is `package://`."""

_FILE = "file://"


class _Place(NamedTuple):
    """A folder in which a file that a robot's model names is searched, and the file's path below that folder."""

    folder: Path
    inside: str
    """Path of the file below the folder, as it is written."""

    prefix: str
    """Text that a URDF has to put before a path in the folder."""


def check_inside(mentioned_in: object, file: Path, root: Path, name: str) -> None:
    """Raises an error if a file is outside the robot's folder, links followed.

    Args:
        mentioned_in: File that names the other file, with the line if known.
        file: Path of the file.
        root: The robot's folder.
        name: The file's name as it is written.

    Raises:
        LaunchError: The file is outside the robot's folder.
    """
    if not file.resolve().is_relative_to(root.resolve()):
        raise invalid(mentioned_in, f"the file {name!r} is outside of {root}; put it into the robot's own folder")


def find_file(name: str, where: str, folder: Path, root: Path) -> Path:
    """Finds a file that a URDF names, also by `package://<package>/…`.

    `package://<package>/…` is searched in the folder of that name, or in the folder of the URDF or one above it.

    Args:
        name: Name of the file as it is written.
        where: File and line that name it, for errors.
        folder: Folder of the URDF.
        root: Folder that has to contain all files.

    Raises:
        LaunchError: The file does not exist or is outside the folder; the message suggests a file of a similar name.
    """
    bare = name.removeprefix(_FILE)
    if not name.startswith((_PACKAGE, _MODEL)) and Path(bare).is_absolute():
        raise invalid(where, f"the file {name!r} is absolute; write {_PACKAGE}<package>/… or a relative name")
    places = list(_places(name, folder, root))
    for place in places:
        file = place.folder / place.inside
        check_inside(where, file, root, name)
        with suppress(OSError):  # a name that is too long
            if file.is_file() and not name.startswith(_MODEL):
                return file.resolve()
    looked = ", ".join(str(place.folder / place.inside) for place in places)[:_MOST_SHOWN]
    meant = next(
        (place.prefix + near for place in places if (near := similar_file(place.folder, place.inside, root))), None
    )
    hint = f"did you mean {meant!r}? Looked for" if meant else "looked for"
    raise invalid(where, f"there is no file {name!r}; {hint} {looked}")


def _places(name: str, folder: Path, root: Path) -> Iterator[_Place]:
    scheme = next((each for each in (_PACKAGE, _MODEL) if name.startswith(each)), None)
    if scheme is None:
        yield _Place(folder, name.removeprefix(_FILE), "")
        return
    package, _, rest = name.removeprefix(scheme).partition("/")
    yield _Place(root, f"{package}/{rest}", _PACKAGE)
    for each in folders_between(folder, root):
        yield _Place(each, rest, f"{_PACKAGE}{package}/")


def folders_between(folder: Path, root: Path) -> list[Path]:
    """Lists a folder and those above it, up to the root."""
    folders = [folder, *folder.parents]
    return folders[: folders.index(root) + 1] if root in folders else [folder]


def similar_file(folder: Path, inside: str, root: Path) -> str | None:
    """Returns the path of the file that a misspelt path probably means.

    The names may differ in case, in escapes such as `%20`, in the form of accents, in the direction of slashes, or in a
    letter or two of the last part.

    Args:
        folder: Folder to which the path is relative.
        inside: Misspelt path.
        root: Folder outside of which nothing is suggested.

    Returns:
        The path as it would be right; `None` where nothing is similar.
    """
    parts = PurePosixPath(unquote(inside).replace("\\", "/")).parts
    found: list[str] = []
    for index, part in enumerate(parts):
        place = folder.joinpath(*found)
        if not place.resolve().is_relative_to(root.resolve()):
            return None
        name = part if part == ".." else _similar_name(place, part, is_last=index == len(parts) - 1)
        if name is None:
            return None
        found.append(name)
    return "/".join(found) if found and folder.joinpath(*found).is_file() else None


def _similar_name(folder: Path, name: str, *, is_last: bool) -> str | None:
    try:
        names = sorted(each.name for each in folder.iterdir())
    except OSError:
        return None
    if name in names:
        return name
    folded = {_folded(each): each for each in names}
    if _folded(name) in folded:
        return folded[_folded(name)]
    # 0.8: a letter or two; more would suggest any other mesh of the robot.
    near = get_close_matches(name, names, n=1, cutoff=0.8) if is_last else []
    return near[0] if near else None


def _folded(name: str) -> str:
    return unicodedata.normalize("NFKC", name).casefold()
