"""Addresses of clusters, `tcp://10.0.0.7:8786`: whether they are any, and whether something listens there."""

import re
import socket

from .backend import BackendError

_ADDRESS = re.compile(r"(?:[a-z]+://)?([^\s/:]+|\[[0-9a-f:.]+\]):([0-9]{1,5})")
_CONNECT_S = 10.0


def is_address(text: str) -> bool:
    """Whether it is a host and a port, with or without a protocol."""
    return _ADDRESS.fullmatch(text) is not None


def check_answer(cluster: str, address: str, program: str) -> None:
    """Finds out at once that nothing listens there; clients of clusters try for long.

    Args:
        cluster: what it is, in words: `the Dask cluster tcp://10.0.0.7:8786`.
        address: where it has to be.
        program: what has to run there.

    Raises:
        BackendError: nothing does; the message says what to check.
    """
    found = _ADDRESS.fullmatch(address)
    assert found is not None
    try:
        socket.create_connection((found[1].strip("[]"), int(found[2])), _CONNECT_S).close()
    except (OSError, OverflowError) as error:
        raise BackendError(
            f"{cluster} does not answer ({error}): check the address in ROBOMAKER_BACKEND, that `{program}` runs "
            "there, and that this machine may connect to its port"
        ) from error
