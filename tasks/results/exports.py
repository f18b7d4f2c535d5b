"""Writes tables to files for other programs: Parquet and CSV; files are replaced atomically."""

import errno
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from ...schemas.wire.errors import ConfigurationError
from ..files.whole_files import replaced

if TYPE_CHECKING:
    import pyarrow as pa


def _write_parquet(table: "pa.Table", path: Path) -> None:
    import pyarrow.parquet as pq

    pq.write_table(table, path, compression="zstd")


def _write_csv(table: "pa.Table", path: Path) -> None:
    from pyarrow import csv

    csv.write_csv(table, path)


WRITERS: Mapping[str, Callable[["pa.Table", Path], None]] = MappingProxyType(
    {".parquet": _write_parquet, ".csv": _write_csv}
)
"""Functions that write a table to a file, by file name suffix."""


def check_extension(path: Path, option: str) -> None:
    """Raises an error for a file whose name has no known suffix, and so no format.

    Args:
        path: Path of the file.
        option: Name of the option that names it, for the error message.

    Raises:
        ConfigurationError: Its name has another end than those of `WRITERS`.
    """
    if path.suffix.lower() not in WRITERS:
        raise ConfigurationError(f"{option} is {path}; a name that ends with {' or '.join(WRITERS)} would be right")


def export_table(table: "pa.Table", path: Path) -> None:
    """Writes a table to a file, in the format of its suffix; an earlier file is replaced atomically.

    If the path is a symbolic link, the linked file is replaced.

    Args:
        table: The table.
        path: Path of the file, whose suffix has passed `check_extension`.

    Raises:
        OSError: It cannot be written; an earlier file is still there.
    """
    target = Path(os.path.realpath(path))  # unlike `resolve`, it does not raise where links lead in a circle
    if target.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    with replaced(target) as part:
        WRITERS[path.suffix.lower()](table, part)
