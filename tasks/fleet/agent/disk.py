"""Application versions on the robot's disk: switches between them atomically, and deletes unneeded ones."""

from __future__ import annotations

import shutil
from collections.abc import Collection

from .deployment import Version
from .errors import StepFailed, disk_failure
from .journal import sync_folder
from .settings import Home


def prepare(home: Home) -> None:
    """Creates the folders of the robot agent's home that are missing, readable to all but the downloads."""
    for folder in (home.folder, home.versions, home.logs):
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o755)
    home.downloads.mkdir(exist_ok=True)


def switch(home: Home, version: Version | None) -> None:
    """Points the symbolic link `current` to a version atomically, or removes it if the version is `None`.

    Raises:
        StepFailed: The version is not there, or the disk is full.
    """
    try:
        if version is None:
            home.current.unlink(missing_ok=True)
        else:
            _lead_to(home, version.folder)
        sync_folder(home.folder)
    except OSError as error:
        raise disk_failure(error, "switching to the version") from error


def _lead_to(home: Home, folder: str) -> None:
    if not (home.folder / folder).is_dir():
        raise StepFailed("EnvironmentSetupError", f"{folder} is gone from the robot's disk")
    if home.current.is_symlink() and home.current.resolve() == (home.folder / folder).resolve():
        return
    link = home.folder / ".current.new"
    link.unlink(missing_ok=True)
    link.symlink_to(folder)
    link.replace(home.current)


def tidy(home: Home, kept: Collection[str]) -> None:
    """Deletes downloads and old versions from the robot.

    Args:
        home: The agent's.
        kept: Folders of versions, below the home.
    """
    for file in home.downloads.iterdir():
        file.unlink()
    for application in home.versions.iterdir():
        for folder in application.iterdir():
            if f"versions/{application.name}/{folder.name}" not in kept:
                shutil.rmtree(folder, ignore_errors=True)
        if not any(application.iterdir()):
            application.rmdir()
