"""Finds the backend that settings name."""

import importlib

from ...schemas.wire.errors import ConfigurationError
from .backend import Backend
from .by_hand import ByHandBackend

_MODULES = {"workers": "work_pools", "dask": "dask_cluster", "ray": "ray_cluster"}
"""Each has a function `backend_at`, and imports its library when that connects."""


def open_backend(named: str) -> Backend | None:
    """Makes the backend that `ROBOMAKER_BACKEND` names; nothing is connected yet.

    Args:
        named: `local`, `by-hand`, `workers:POOL`, `dask:ADDRESS` or `ray:ADDRESS`.

    Returns:
        The backend; `None`: batches run in the process that carries them out.

    Raises:
        ConfigurationError: there is no such backend, or its address is missing.
    """
    kind, _, place = named.partition(":")
    if named == "local":
        return None
    if named == "by-hand":
        return ByHandBackend()
    if kind not in _MODULES or not place:
        raise ConfigurationError(
            f"ROBOMAKER_BACKEND is {named!r}; it has to be local, by-hand, workers:POOL, dask:ADDRESS or ray:ADDRESS"
        )
    backend: Backend = importlib.import_module(f".{_MODULES[kind]}", __package__).backend_at(place)
    return backend
