"""The recorded home: a small run's catalog and stored outputs, which every later version has to open."""

import os
import shutil
import sqlite3
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path

from .records import FOLDER

SPECIFICATION = FOLDER.parent / "recorded.yaml"
HOME = FOLDER / "home.tar.xz"
_PLACE = Path("/var/tmp/recorded-home")  # noqa: S108 - a home has its own path in it, which no user is to be known by
_CATALOG = "catalog.sql"
_KEPT = (_CATALOG, "objects", "runs")
"""The catalog as text, and folders of a home that hold results; the others are caches, locks, and Prefect's own."""
_TIME_LIMIT_S = 600


def record_home() -> None:
    """Runs the specification in a home of its own, and packs its catalog and files beside the facts.

    Raises:
        RuntimeError: The specification cannot be run, or the home's place is taken.
    """
    try:
        _PLACE.mkdir(mode=0o700)
    except FileExistsError:
        raise RuntimeError(f"{_PLACE} is there already; remove it") from None
    try:
        (_PLACE / "venv").symlink_to(sys.prefix)  # programs have its folder on their path, which is recorded
        shutil.copy(SPECIFICATION, _PLACE)
        _run("run", SPECIFICATION.name, expected=1)  # one requirement is missed, so that there is one to read
        _run("server", "stop", "--force", expected=0)
        FOLDER.mkdir(parents=True, exist_ok=True)
        (_PLACE / _CATALOG).write_text("\n".join(_catalog_as_text(_PLACE / "catalog.db")) + "\n")
        _pack(_PLACE, HOME)
    finally:
        shutil.rmtree(_PLACE)


def unpack_home(home: Path) -> None:
    """Makes a data home of what is recorded.

    Args:
        home: Folder for it, which is empty or not there yet.
    """
    home.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tarfile.open(HOME) as archive:
        archive.extractall(home, filter="data")
    connection = sqlite3.connect(home / "catalog.db")
    try:
        connection.executescript((home / _CATALOG).read_text())
    finally:
        connection.close()


def _run(*words: str, expected: int) -> None:
    """Runs a command of ours with an environment and under a host name that say nothing of this machine."""
    command = [str(_PLACE / "venv" / "bin" / "python"), "-m", "prefect_robomaker", *words]
    environment = {
        "PATH": os.defpath,
        "HOME": str(_PLACE),
        "ROBOMAKER_HOME": str(_PLACE),
        "TMPDIR": str(_PLACE),
    }
    named = ["unshare", "--uts", "--map-root-user", "sh", "-c", 'hostname recorder && exec "$@"', "sh", *command]
    done = subprocess.run(
        named, env=environment, cwd=_PLACE, capture_output=True, text=True, timeout=_TIME_LIMIT_S, check=False
    )
    if done.returncode != expected:
        raise RuntimeError(f"`robomaker {' '.join(words)}` ended with {done.returncode}: {done.stderr[-2000:]}")


def _catalog_as_text(path: Path) -> Iterator[str]:
    connection = sqlite3.connect(path)
    try:
        yield from connection.iterdump()
    finally:
        connection.close()


def _pack(home: Path, target: Path) -> None:
    """Packs the kept folders, without times and owners, so that the same files give the same archive."""

    def plain(member: tarfile.TarInfo) -> tarfile.TarInfo:
        member.mtime = member.uid = member.gid = 0
        member.uname = member.gname = ""
        return member

    with tarfile.open(target, "w:xz") as archive:
        tops = [home / name for name in _KEPT]
        for path in sorted(path for top in tops for path in (top, *top.rglob("*"))):
            archive.add(path, path.relative_to(home), recursive=False, filter=plain)
