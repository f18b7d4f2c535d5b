"""Files of the machine that a sandboxed run can see: the system, Python and its imports, and the run's own folders."""

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from .kernel import Rules

_SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32", "/opt", "/etc", "/nix", "/snap")
_FOREIGN = ("/", "/home", "/root", "/tmp", "/var", "/var/tmp", "/run", "/proc", "/sys", "/dev")
"""Folders that are never visible as a whole, even if Python imports from them."""

_DEVICES = ("null", "zero", "full", "random", "urandom", "tty", "ptmx", "pts", "shm", "dri", "kfd")

_PATH_VARIABLES = (
    *("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "LIBGL_DRIVERS_PATH", "__EGL_VENDOR_LIBRARY_DIRS"),
    *("MENAGERIE_ROOT", "MENAGERIE_CACHE_DIR"),
    *("AWS_DATA_PATH", "AWS_CONFIG_FILE", "AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE", "AWS_CA_BUNDLE"),
)

_OF_TOOLS = ("bin", "lib", "lib64", "libexec", "shims", "versions", "version", "installs", "plugins", "toolchains")
"""Names of folders next to a `bin` folder that its programs need.

Programs in a home folder are installed so by pyenv, asdf, conda, rustup or pip. `share` and settings files are not
needed: job workers keep data in one, tools keep keys in the other.
"""

View = Literal["read", "write", "hide"]


@dataclass(frozen=True)
class Sight:
    """A file or folder that a sandboxed run may see, and whether it may write to it."""

    path: str
    view: View


@cache
def system_sights() -> tuple[Sight, ...]:
    """Lists the system files that every sandboxed run may see: programs and libraries."""
    shown = [Sight(path, "read") for path in _SYSTEM if os.path.lexists(path)]
    if os.path.islink("/etc/resolv.conf"):  # often into /run, which runs do not see
        shown.append(Sight(os.path.realpath("/etc/resolv.conf"), "read"))
    return (*shown, *(Sight(path, "hide") for path in _secrets_below("/etc")))


def python_paths(import_path: Iterable[str]) -> list[Path]:
    """Returns the folders of Python and its imports, which a sandboxed run has to see.

    Args:
        import_path: `sys.path` of the process that requested the run.
    """
    found = {*map(os.path.abspath, import_path), sys.prefix, sys.base_prefix}
    found |= {os.path.realpath(path) for path in found} | {os.path.dirname(os.path.realpath(sys.executable))}
    # What is installed in editable form is found by a table and not by the path.
    for name, module in list(sys.modules.items()):
        if name.startswith("__editable__"):
            found |= {os.path.realpath(folder) for folder in getattr(module, "MAPPING", {}).values()}
    return _worth_showing(found)


def paths_in(variables: Mapping[str, str]) -> list[Path]:
    """Returns files and folders that environment variables such as `PATH`, `PYTHONPATH` and `AWS_CONFIG_FILE` name.

    Next to a `bin` folder also `lib` and others that its programs need. Left out is what does not exist, what every run
    sees as part of the system, and folders such as the home folder that hold much else.

    Args:
        variables: Environment variables of the job worker or of the run.
    """
    named = {path for name in _PATH_VARIABLES for path in variables.get(name, "").split(os.pathsep)}
    return _worth_showing(each for path in named if os.path.isabs(path) for each in (path, *_beside(path)))


def _beside(path: str) -> Iterable[str]:
    folder, name = os.path.split(path.rstrip("/"))
    return (f"{folder}/{each}" for each in _OF_TOOLS) if name in ("bin", "sbin", "shims") else ()


def _worth_showing(paths: Iterable[str]) -> list[Path]:
    """Returns those of some paths that exist, sorted, without system folders and wide ones such as `/tmp`."""
    system = tuple(f"{path}/" for path in _SYSTEM)
    return [
        Path(path)
        for path in sorted(set(paths))
        if os.path.exists(path)
        and not f"{path}/".startswith(system)
        and not is_wide(path)
        and not is_wide(os.path.realpath(path))
    ]


def is_wide(folder: str | Path) -> bool:
    """Returns whether a folder holds much else, as `/tmp` and home folders do, so that no run sees all of it."""
    home = os.path.expanduser("~")
    return str(folder) in {*_FOREIGN, home, os.path.realpath(home)}


def ordered(sights: Iterable[Sight]) -> list[Sight]:
    """Returns visible files, each path once, in the order in which they are mounted: folders before their content."""
    return sorted({sight.path: sight for sight in sights}.values(), key=lambda sight: sight.path.count("/"))


def _secrets_below(folder: str) -> list[str]:
    """Lists paths below a folder that not all users may read, if this process is root: its sandbox could read them.

    For other users the list is empty.
    """
    if os.geteuid() != 0:
        return []
    found = []
    for parent, folders, files in os.walk(folder):
        for name in [*folders, *files]:
            path = os.path.join(parent, name)
            if not os.path.islink(path) and not os.lstat(path).st_mode & 0o004:
                found.append(path)
        folders[:] = [name for name in folders if os.path.join(parent, name) not in found]
    return found


def readable_rules(sights: Iterable[Sight]) -> list[Rules]:
    """Converts a run's visible files, with those of the system, to Landlock rules; hidden paths get none."""
    every = [*system_sights(), *sights]
    hidden = {os.path.realpath(sight.path) for sight in every if sight.view == "hide"}
    rules = [Rules(path, writable=True) for path in (f"/dev/{name}" for name in _DEVICES)]
    rules += [Rules(str(path), writable=True) for path in Path("/dev").glob("nvidia*")]
    rules += [Rules(path, writable=False) for path in ("/proc", "/sys")]
    for sight in every:
        if sight.view == "write":
            rules.append(Rules(sight.path, writable=True))
        elif sight.view == "read":
            rules += [Rules(path, writable=False) for path in _without(os.path.realpath(sight.path), hidden)]
    return rules


def _without(path: str, hidden: set[str]) -> list[str]:
    if path in hidden:
        return []
    if not any(other.startswith(path + "/") for other in hidden):
        return [path]
    return [found for name in os.listdir(path) for found in _without(os.path.realpath(f"{path}/{name}"), hidden)]
