"""Hashes of code: folders, and packages that a run imported."""

import hashlib
import os
import re
import site
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, lru_cache
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

_IGNORED_FOLDER = "__pycache__"
_PREVIEW_FILE = "preview.png"


def digest_of_folder(folder: Path, suffix: str = "") -> str:
    """Computes the SHA-256 over the names and contents of a folder's files, without byte code and previews.

    Args:
        folder: The folder.
        suffix: Suffix that the file names must have.
    """
    digest = hashlib.sha256()
    files = {path.relative_to(folder).as_posix(): path for path in _files_in(folder) if path.name.endswith(suffix)}
    for name in sorted(files):
        if name != _PREVIEW_FILE:
            with files[name].open("rb") as file:
                content = hashlib.file_digest(file, "sha256").digest()
            digest.update(f"{name}\0".encode() + content)
    return digest.hexdigest()


def _files_in(folder: Path) -> Iterator[Path]:
    """Yields all files below a folder, following links to folders, each real folder once on a path.

    Folders of compiled code are left out.
    """
    ways = {str(folder): frozenset({os.path.realpath(folder)})}
    for place, folders, files in os.walk(folder, followlinks=True):
        above = ways.pop(place)
        if _IGNORED_FOLDER in folders:
            folders.remove(_IGNORED_FOLDER)
        for name in list(folders):
            real = os.path.realpath(os.path.join(place, name))  # noqa: PTH118 - half the time of `Path`
            if real in above:  # a link to a folder that it lies in
                folders.remove(name)
            else:
                ways[os.path.join(place, name)] = above | {real}  # noqa: PTH118
        yield from (path for name in files if (path := Path(place, name)).is_file())


_OWN = "prefect_robomaker"
_DIST_INFO = re.compile(r"(?P<name>.+)-(?P<version>[^-]+)\.(dist|egg)-info")


def imported_code(modules: Mapping[str, ModuleType], application_dirs: Sequence[Path] = ()) -> dict[str, str]:
    """Lists the third-party packages and modules that a process has imported, with versions or hashes.

    Args:
        modules: Modules of the process (`sys.modules`).
        application_dirs: Folders of unpacked applications, whose files are hashed separately.

    Returns:
        By name of the outermost package or module: the version of the installed distribution of that name; of one that
        an installed distribution brings under another name, size and time of its file; else a digest of its files.
    """
    found: dict[str, str] = {}
    for name, module in list(modules.items()):
        if "." in name or name in sys.stdlib_module_names or name in ("__main__", "__mp_main__", _OWN):
            continue
        places = _places(getattr(module, "__spec__", None))
        is_outside = not any(place.is_relative_to(folder) for place in places for folder in application_dirs)
        if places and is_outside and (what := _identity_of(name, places)) is not None:
            found[name] = what
    return found


def digest_of_code(name: str, modules: Mapping[str, ModuleType]) -> str:
    """Computes the SHA-256 over an imported package's files, or over a module and what was imported from beside it.

    Beside a module in a folder of installed distributions is unrelated code, which does not count.

    Args:
        name: Name of the outermost package or module.
        modules: Modules of the process (`sys.modules`).

    Returns:
        The hash in hexadecimal; empty if the module was not imported.
    """
    places = _places(getattr(modules.get(name), "__spec__", None))
    if not places:
        return ""
    folder = places[0].parent
    if places[0].is_dir():  # a package's networks count as its code does
        found = {name: " ".join(map(digest_of_folder, places))}
    elif folder in installed_places():
        found = {name: digest_of_file(places[0])}
    else:
        parents = {
            each: {place.parent for place in _places(getattr(module, "__spec__", None))}
            for each, module in list(modules.items())
            if "." not in each
        }
        found = imported_code({each: modules[each] for each, there in parents.items() if folder in there})
    return hashlib.sha256("".join(f"{each}\0{what}\0" for each, what in sorted(found.items())).encode()).hexdigest()


def digest_of_file(path: Path) -> str:
    """Computes the SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def changed_code(recorded: Mapping[str, str]) -> str | None:
    """Returns the first package that differs from a recorded list; `None` if all are the same."""
    return next((name for name, what in sorted(recorded.items()) if _code_here(name) != what), None)


def _code_here(name: str) -> str:
    try:
        places = _places(find_spec(name))
        return (_identity_of(name, places) if places else None) or ""
    except (ImportError, OSError, ValueError):
        return ""


def _places(spec: ModuleSpec | None) -> list[Path]:
    """Returns the folders of a package, or the file of a module.

    Returns an empty list for built-in, generated and absent modules.
    """
    if spec is None:
        return []
    if folders := list(spec.submodule_search_locations or ()):
        return [Path(folder) for folder in folders]
    return [Path(spec.origin)] if spec.has_location and spec.origin else []


def _identity_of(name: str, places: Sequence[Path]) -> str | None:
    """Returns a version or hash that identifies a module's code; None: it is part of Python or of a package.

    Compiled modules may load parts of themselves under a name without dots.
    """
    installed = installed_places()
    if all(place.parent in installed for place in places):
        return _version(name, places[0].parent) or _stamp(places[0])
    of_python = Path(sysconfig.get_path("stdlib"))
    if any(place.is_relative_to(folder) for place in places for folder in (*installed, of_python)):
        return None
    return " ".join(_digest(place) for place in places)


@cache
def installed_places() -> frozenset[Path]:
    """Returns the folders where distributions are installed; editable installs are elsewhere."""
    names = [sysconfig.get_path(kind) for kind in ("purelib", "platlib")]
    return frozenset(Path(name) for name in (*names, *site.getsitepackages(), site.getusersitepackages()))


def _version(name: str, folder: Path) -> str | None:
    version = _versions_in(folder, folder.stat().st_mtime_ns).get(name.lower().replace("_", "-"))
    return f"version {version}" if version else None


@lru_cache(maxsize=8)
def _versions_in(folder: Path, changed_ns: int) -> Mapping[str, str]:
    """Reads versions of distributions from the names of their folders, as reading all metadata takes 150 ms.

    Args:
        folder: Folder where distributions are installed.
        changed_ns: Modification time of the folder, part of the cache key, so that long-running processes see new
            installations.
    """
    del changed_ns
    matches = (_DIST_INFO.fullmatch(path.name) for path in folder.iterdir())
    return {match["name"].lower().replace("_", "-"): match["version"] for match in matches if match}


def _stamp(place: Path) -> str:
    """Returns a mark that changes when a module whose distribution has another name is installed anew or deleted."""
    file = place / "__init__.py" if place.is_dir() else place
    if not file.exists():
        return "installed"
    stat = file.stat()
    return f"installed {stat.st_size} {stat.st_mtime_ns}"


def _digest(place: Path) -> str:
    if place.is_dir():
        return f"package {digest_of_folder(place, '.py')}"
    return f"module {digest_of_file(place)}"
