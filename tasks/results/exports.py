"""Tables in files for other programs: Parquet and CSV, written beside the file and renamed."""

import errno
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from ...schemas.wire.errors import ConfigurationError

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
"""Functions that write a table to a file, by the end of the file's name."""


def check_extension(path: Path, option: str) -> None:
    """Refuses a file whose name does not say in which form it is to be written.

    Args:
        path: the file.
        option: name of the option that names it, for the error message.

    Raises:
        ConfigurationError: its name has another end than those of `WRITERS`.
    """
    if path.suffix.lower() not in WRITERS:
        raise ConfigurationError(f"{option} is {path}; a name that ends with {' or '.join(WRITERS)} would be right")


def export_table(table: "pa.Table", path: Path) -> None:
    """Writes a table to a file in the form that the end of its name says; an earlier file stays whole until then.

    A symbolic link stays one: the file that it leads to is written.

    Args:
        table: the table.
        path: the file; see `check_extension`.

    Raises:
        OSError: it cannot be written; an earlier file is still there.
    """
    target = Path(os.path.realpath(path))  # unlike `resolve`, it does not raise where links lead in a circle
    if target.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        WRITERS[path.suffix.lower()](table, part)
        part.replace(target)
    finally:
        with suppress(OSError):  # a folder that takes no file says so above
            part.unlink()
