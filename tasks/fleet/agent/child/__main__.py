"""`python -m …child HOME`: does what standard input asks for, and says on standard output how it went."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..deployment import Order, deployment_of
from ..errors import StepFailed, TryLater
from ..settings import Home
from ..states import Phase
from .answers import line
from .fetching import fetch, source_of


def main() -> int:
    """Does one request; the exit code is 0 once an answer was given."""
    home, asked = Home(Path(sys.argv[1])), json.loads(sys.stdin.buffer.read())
    try:
        if asked["phase"] == Phase.VALIDATING.value:
            _validate(home, asked)
        else:
            _download(home, asked)
    except StepFailed as error:
        _say(failed=[error.code, error.reason])
    except TryLater as error:
        _say(later=str(error))
    return 0


def _validate(home: Home, asked: Mapping[str, Any]) -> None:
    from .trust import Repository  # needs memory, which downloads are spared

    source = source_of(home.connection())
    repository = Repository(source, home.root_file.read_bytes(), home.metadata, home.downloads, time.time())
    deployment = repository.resolve(
        Order(**asked["order"]),
        asked["floors"],
        asked["newest_s"],
        asked["architecture"],
        lambda trusted: _say(trusted=asdict(trusted)),
    )
    _say(deployment=asdict(deployment))


def _download(home: Home, asked: Mapping[str, Any]) -> None:
    from .unpacking import unpack

    deployment = deployment_of(asked["deployment"])
    folder = home.folder / deployment.version.folder
    if not folder.exists():
        archive = home.downloads / deployment.bundle.sha256
        fetch(source_of(home.connection()), deployment.bundle, archive, _Progress())
        try:
            unpack(archive, folder)
        except StepFailed:
            archive.unlink()
            raise
        archive.unlink()
    _say(passed=True)


class _Progress:
    """Says each percent once."""

    def __init__(self) -> None:
        self._said = -1

    def __call__(self, done: int, of: int) -> None:
        percent = 100 * done // max(1, of)
        if percent > self._said:
            self._said = percent
            _say(progress=percent)


def _say(**content: Any) -> None:
    sys.stdout.write(line(**content))
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
