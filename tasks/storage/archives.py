"""Unpacks untrusted archives safely, and packs folders reproducibly."""

import gzip
import os
import shutil
import tarfile
import tempfile
from pathlib import Path

from ...schemas.wire.errors import BundleError
from ..bundles.archive_members import ArchiveError
from ..bundles.extraction import ArchiveLimits, extract
from ..files.untrusted_folders import open_regular, os_failures, regular_files
from ..files.whole_files import replaced


def unpack(archive: Path, folder: Path, *, limits: ArchiveLimits | None = None) -> None:
    """Unpacks a .tar, .tar.gz or .zip archive from an untrusted source.

    Files become readable by all and executable where the archive says so; owners, times and special
    modes are dropped.

    Args:
        archive: The archive.
        folder: Target folder, which must be absent or empty, and appears only when everything is unpacked.
        limits: Limits of its content.

    Raises:
        BundleError: It is no archive, is damaged or too large, or has a member that is neither file nor
            folder or would land elsewhere; the message names the member. Nothing is left behind.
        StorageError: The disk is full, or the folder cannot be written.
    """
    with os_failures(f"unpack {archive.name} into {folder}"):
        folder.parent.mkdir(parents=True, exist_ok=True)
        unpacked = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        try:
            unpacked.chmod(0o755)
            extract(archive, unpacked, limits or ArchiveLimits())
            unpacked.rename(folder)
        except ArchiveError as error:
            raise BundleError(str(error)) from error
        finally:
            shutil.rmtree(unpacked, ignore_errors=True)


def pack_tar_gz(folder: Path, path: Path) -> None:
    """Packs a folder into a reproducible .tar.gz: equal files give equal bytes.

    Args:
        folder: Folder to pack; empty folders are left out.
        path: The archive; it appears when it is whole.

    Raises:
        StorageError: A file is a symbolic link or the like, or cannot be read; the disk is full.
    """
    files = regular_files(folder)
    with (
        os_failures(f"pack {folder} into {path}"),
        replaced(path) as part,
        part.open("xb") as target,
        gzip.GzipFile(filename="", mode="wb", fileobj=target, mtime=0, compresslevel=6) as zipped,
        tarfile.open(fileobj=zipped, mode="w", format=tarfile.PAX_FORMAT) as container,
    ):
        for file in files:
            with open_regular(file.path) as content:
                found = os.fstat(content.fileno())
                info = tarfile.TarInfo(file.name)
                info.size = found.st_size
                info.mode = 0o755 if found.st_mode & 0o100 else 0o644
                container.addfile(info, content)
