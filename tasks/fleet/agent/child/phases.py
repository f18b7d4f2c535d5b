"""Phases of an installation that the child process runs: verifying the order, downloading and unpacking the archive."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Callable

from ..errors import StepFailed, TryLater
from ..settings import Home
from ..state_machine import Phase, State
from .fetching import fetch, source_of
from .unpacking import unpack

if TYPE_CHECKING:
    from .trust import Repository

_PROGRESS_EVERY_S = 0.5

Say = Callable[..., None]
"""Function that sends an answer from the child process to the agent; see `forking`."""


def carry_out(home: Home, state: State, architecture: str, say: Say) -> None:
    """Carries out a phase of a deployment (verify, download, unpack) in the agent's child process.

    Args:
        home: The agent's.
        state: State of the agent.
        architecture: The robot's.
        say: Answers.
    """
    try:
        if state.phase is Phase.VALIDATING:
            _validate(home, state, architecture, say)
        else:
            _download(home, state, say)
    except StepFailed as error:
        say(failed=[error.code, error.reason])
    except TryLater as error:
        say(later=str(error))


def _validate(home: Home, state: State, architecture: str, say: Say) -> None:
    make_repository = _repository_class()
    order = state.order
    assert order is not None
    source = source_of(home.connection())
    repository = make_repository(source, home.root_file.read_bytes(), home.metadata, home.downloads, time.time())
    seen: dict[str, Any] = {}
    try:
        deployment = repository.resolve(
            order, state.floors, state.newest_s, architecture, lambda trusted: seen.update(trusted=asdict(trusted))
        )
    except Exception:
        if seen:
            say(**seen)
        raise
    say(**seen, deployment=asdict(deployment))  # in one line, so that the journal is written once for both


def _repository_class() -> type[Repository]:
    """Imports TUF and returns the repository class.

    It is imported only to verify, and without TUF's HTTP client, which would take a third of its import time.
    """
    fetcher = "tuf.ngclient.urllib3_fetcher"
    sys.modules[fetcher] = SimpleNamespace(Urllib3Fetcher=object)  # type: ignore[assignment]
    try:
        from .trust import Repository
    except (ImportError, AttributeError):  # a TUF that needs more of it
        del sys.modules[fetcher]
        from .trust import Repository
    return Repository


def _download(home: Home, state: State, say: Say) -> None:
    deployment = state.deployment
    assert deployment is not None
    folder = home.folder / deployment.version.folder
    if not folder.exists():
        archive = home.downloads / deployment.bundle.sha256
        fetch(source_of(home.connection()), deployment.bundle, archive, Progress(say))
        try:
            unpack(archive, folder)
        except StepFailed:
            archive.unlink()
            raise
        archive.unlink()
    say(passed=True)


class Progress:
    """Reports a download's progress to the agent, not more often than useful.

    Args:
        say: Answers.
        monotonic: A clock that only goes forward, in seconds.
    """

    def __init__(self, say: Say, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._say = say
        self._monotonic = monotonic
        self._due_s = 0.0

    def __call__(self, done: int, of: int) -> None:
        """Reports the download's progress in percent from its downloaded bytes and all bytes, not too often."""
        now_s = self._monotonic()
        if now_s >= self._due_s:
            self._due_s = now_s + _PROGRESS_EVERY_S
            self._say(progress=100 * done // max(1, of))
