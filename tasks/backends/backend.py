"""Interface of backends, the backend whose workers a user starts by hand, and opening the backend in the settings."""

import importlib
import importlib.util
import re
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from ...schemas.backends import BACKENDS_IN_WORDS
from ...schemas.discovery import named
from ...schemas.extras import how_to_install
from ...schemas.wire.common import counted
from ...schemas.wire.errors import ConfigurationError, RobomakerError

JOB_WORKER_FLOW = "RunJobWorker"
"""Name of the flow that runs a job worker in a work pool; its deployment is named after the pool."""

MISCONFIGURED = "Misconfigured"
"""Name of the state in which that flow ends if the machine's settings lead to another catalog than the batch's."""


class BackendError(RobomakerError):
    """Raised when job workers of a batch cannot be started and waiting does not help; the message says why."""


class JobWorkers(Protocol):
    """Interface of the job workers (processes that run simulation jobs) which a backend has started for one batch."""

    def look(self) -> str:
        """Starts job workers on newly found machines, and restarts those that ended before the batch did.

        Called several times a second, from one thread; returns at once.

        Returns:
            Text for the user about the job workers: `2 job workers on tcp://10.0.0.7:8786`.

        Raises:
            BackendError: No job worker can be started.
        """
        ...


class Backend(Protocol):
    """Interface of a backend (Dask, Ray, work pool, ...), which starts a batch's job workers on other machines."""

    def check(self) -> None:
        """Checks, before a run begins, that the cluster or work pool exists and answers.

        Raises:
            BackendError: The cluster or work pool does not exist or does not answer.
        """
        ...

    def job_workers(self, batch: str, wanted: int) -> AbstractContextManager[JobWorkers]:
        """Starts job workers for a batch inside a `with` block; at its end the remaining ones are stopped.

        Args:
            batch: ARN of the batch.
            wanted: Number of job workers that can be of use.

        Raises:
            BackendError: The cluster or work pool does not exist.
        """
        ...


class ByHandBackend:
    """Backend that starts no job workers itself, and tells the user which command starts one on another machine."""

    def check(self) -> None:
        """Does nothing, and never raises: a user may start the batch's job workers at any time."""

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Iterator["ByHandWorkers"]:
        """Yields job workers that a user starts by hand; nothing is started here."""
        yield ByHandWorkers(batch, wanted)


class ByHandWorkers:
    """Job workers that a user starts by hand on other machines, so that their number is not known here.

    Args:
        batch: ARN of the batch.
        wanted: Number of job workers that can be of use.
    """

    def __init__(self, batch: str, wanted: int) -> None:
        self._words = f"up to {counted(wanted, 'job')} at once; on each machine: robomaker work {batch}"

    def look(self) -> str:
        """Returns the command by which a user starts a job worker for the batch, as text; starts nothing."""
        return self._words


_ADDRESS = re.compile(r"(?:[a-z]+://)?([^\s/:]+|\[[0-9a-f:.]+\]):([0-9]{1,5})")
_CONNECT_S = 10.0


def check_place(kind: str, place: str, *, library: str, wanted: str) -> None:
    """Validates a cluster address in `ROBOMAKER_BACKEND`, without connecting, and that its library is installed.

    Args:
        kind: Kind of the cluster, and extra that installs its library: `dask`.
        place: Address after the kind: a host and a port, with or without a protocol.
        library: The module that speaks with the cluster.
        wanted: Description of a valid address, for the error message.

    Raises:
        ConfigurationError: The address is not valid, or the library of the cluster is not installed.
    """
    if _ADDRESS.fullmatch(place) is None:
        raise ConfigurationError(f"ROBOMAKER_BACKEND is '{kind}:{place}'; after {kind}: there has to be {wanted}")
    if importlib.util.find_spec(library) is None:
        raise ConfigurationError(
            f"ROBOMAKER_BACKEND is '{kind}:{place}', and {kind.capitalize()} is not installed: {how_to_install(kind)}"
        )


def check_answer(cluster: str, address: str, program: str) -> None:
    """Raises an error at once if no program listens at a cluster's address; the clusters' own clients try for long.

    Args:
        cluster: Description for messages: `the Dask cluster tcp://10.0.0.7:8786`.
        address: Host and port of the cluster.
        program: Name of the program that has to listen there.

    Raises:
        BackendError: No program listens at the address; the message says what to check.
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


_OWN = {"workers": "work_pools", "dask": "dask_cluster", "ray": "ray_cluster"}
_MODULES = {**named("backends"), **{kind: f"{__package__}.{module}" for kind, module in _OWN.items()}}
"""Module of each kind of backend, by kind.

It has a function `backend_at`, and imports the cluster's library only when it connects.
"""


def open_backend(setting: str) -> Backend | None:
    """Creates the backend that `ROBOMAKER_BACKEND` names; it does not connect yet.

    Args:
        setting: `local`, `by-hand`, `workers:POOL`, `dask:ADDRESS` or `ray:ADDRESS`.

    Returns:
        The backend; `None`: batches run in the process that carries them out.

    Raises:
        ConfigurationError: `ROBOMAKER_BACKEND` names no backend, lacks its address, or its module cannot be used.
    """
    kind, _, place = setting.partition(":")
    if setting == "local":
        return None
    if setting == "by-hand":
        return ByHandBackend()
    if kind not in _MODULES or not place:
        raise ConfigurationError(f"ROBOMAKER_BACKEND is {setting!r}; it has to be {BACKENDS_IN_WORDS}")
    module = _MODULES[kind]
    try:
        backend: Backend = importlib.import_module(module).backend_at(place)
    except RobomakerError:
        raise
    except Exception as error:
        raise ConfigurationError(f"ROBOMAKER_BACKEND is {setting!r}: {module} cannot be used: {error}") from error
    return backend
