"""Unpacks an application's archive into the folder of its version, which appears only when it is complete."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ..bundles.archive_members import ArchiveError
from ..bundles.colcon import unpack_overlays
from ..bundles.extraction import SYSTEM_TREE, ArchiveLimits, extract
from ..errors import StepFailed, disk_failure
from ..journal import sync_folder


def unpack(archive: Path, folder: Path, limits: ArchiveLimits | None = None) -> None:
    """Unpacks an archive unless its folder exists; for an archive of `colcon bundle`, also its overlays.

    Args:
        archive: A .tar, .tar.gz or .zip.
        folder: Folder to unpack to; the folder beside it with a dot and `.part` is replaced.
        limits: Limits on files and bytes.

    Raises:
        StepFailed: The archive is damaged, or has a member that is neither file nor folder or leads elsewhere; or the
            disk is full. Nothing is left of it then.
    """
    if folder.exists():
        return
    part = folder.with_name(f".{folder.name}.part")
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        try:
            extract(archive, part, limits or ArchiveLimits())
            unpack_overlays(part, _unpack_system_tree)
            _sync(part)
            part.rename(folder)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
        sync_folder(folder.parent)
    except ArchiveError as error:
        raise StepFailed("ExtractingBundleFailure", str(error)) from error
    except OSError as error:
        raise disk_failure(error, f"unpacking {folder.name}") from error


def _unpack_system_tree(archive: Path, folder: Path) -> None:
    folder.mkdir()
    extract(archive, folder, SYSTEM_TREE)


def _sync(top: Path) -> None:
    """Makes files, folders and their names survive a power loss, and folders readable to all."""
    for folder, _, files in os.walk(top):
        Path(folder).chmod(0o755)
        for name in files:
            if os.path.islink(os.path.join(folder, name)):  # noqa: PTH114, PTH118 - half the time of `Path`
                continue  # its folder keeps it
            descriptor = os.open(Path(folder, name), os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        sync_folder(Path(folder))
