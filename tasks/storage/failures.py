"""Turns errors of the operating system into errors of the object store."""

import errno
from collections.abc import Generator
from contextlib import contextmanager

from ...schemas.wire.errors import (
    StorageAccessDeniedError,
    StorageError,
    StorageFullError,
    StorageUnavailableError,
)

_FULL = {errno.ENOSPC, errno.EDQUOT}
# What a network file system says while its server is away; a connection that breaks or cannot be made.
_AWAY = {
    errno.EIO,
    errno.EREMOTEIO,
    errno.ESTALE,
    errno.ETIMEDOUT,
    errno.ENOTCONN,
    errno.ECONNREFUSED,
    errno.ECONNRESET,
    errno.ECONNABORTED,
    errno.EPIPE,
    errno.EHOSTDOWN,
    errno.EHOSTUNREACH,
    errno.ENETDOWN,
    errno.ENETUNREACH,
}
_DENIED = {errno.EACCES, errno.EPERM, errno.EROFS}


@contextmanager
def os_failures(doing: str) -> Generator[None]:
    """Turns every `OSError` inside the block into the `StorageError` that fits.

    Args:
        doing: what is being done, in words that follow "cannot".
    """
    try:
        yield
    except OSError as error:
        raise from_os_error(error, doing) from error


def from_os_error(error: OSError, doing: str) -> StorageError:
    """The error to raise; its message says what could not be done and why."""
    why = error.strerror or str(error)
    where = f" ({error.filename})" if error.filename else ""
    kind = StorageError
    if error.errno in _FULL:
        kind = StorageFullError
    elif error.errno in _AWAY:
        kind = StorageUnavailableError
    elif error.errno in _DENIED:
        kind = StorageAccessDeniedError
    return kind(f"cannot {doing}: {why}{where}")
