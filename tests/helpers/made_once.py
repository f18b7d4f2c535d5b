"""Folders that a test run makes once, whichever of its workers needs them first."""

import fcntl
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


def shared_folder(factory: pytest.TempPathFactory) -> Path:
    """A folder that all workers of this test run see, and no other run."""
    own = factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "made-once"
    folder.mkdir(exist_ok=True)
    return folder


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Inside the block, nobody else of any process or thread is inside a block of the same file."""
    with path.open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that is made by the first who asks for it; the others wait, and then only read it.

    Args:
        factory: Pytest's fixture.
        name: The folder's name.
        make: Makes it, at a path where nothing is yet.
    """
    assert re.fullmatch(r"[\w.-]+", name)
    place = shared_folder(factory)
    folder = place / name
    with locked(place / f"{name}.lock"):
        if not folder.exists():
            half = place / f"{name}.{os.getpid()}.half"  # one that could not be made whole is never found
            shutil.rmtree(half, ignore_errors=True)
            make(half)
            half.rename(folder)
    return folder
