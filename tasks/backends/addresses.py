"""Addresses of clusters, `tcp://10.0.0.7:8786`: whether they are any, and whether something listens there."""

import importlib.util
import re
import socket

from ...schemas.extras import how_to_install
from ...schemas.wire.errors import ConfigurationError
from .backend import BackendError

_ADDRESS = re.compile(r"(?:[a-z]+://)?([^\s/:]+|\[[0-9a-f:.]+\]):([0-9]{1,5})")
_CONNECT_S = 10.0


def check_place(kind: str, place: str, *, library: str, wanted: str) -> None:
    """Checks what `ROBOMAKER_BACKEND` says of a cluster, as far as that needs no connection.

    Args:
        kind: of the cluster, and the extra that brings its library: `dask`.
        place: what stands after it: a host and a port, with or without a protocol.
        library: the module that speaks with the cluster.
        wanted: what the place has to be, in words.

    Raises:
        ConfigurationError: that is no address, or the library is not installed.
    """
    if _ADDRESS.fullmatch(place) is None:
        raise ConfigurationError(f"ROBOMAKER_BACKEND is '{kind}:{place}'; after {kind}: there has to be {wanted}")
    if importlib.util.find_spec(library) is None:
        raise ConfigurationError(
            f"ROBOMAKER_BACKEND is '{kind}:{place}', and {kind.capitalize()} is not installed: {how_to_install(kind)}"
        )


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
