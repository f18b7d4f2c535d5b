"""Showing a deployment that is followed: lines, or a block on a terminal."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TextIO

from .....tasks.fleet.views.following import Look
from ..progress import is_animated
from .lines import LineWatcher

Show = Callable[[Look], None]


@contextmanager
def fleet_watcher(stream: TextIO, environ: Mapping[str, str]) -> Iterator[Show]:
    """Chooses how looks are shown: as lines, or on a terminal as a block that stays at the end.

    Args:
        stream: where to write.
        environ: environment variables; `CI` and a dumb `TERM` mean lines.
    """
    if not is_animated(stream, environ):
        yield LineWatcher(stream)
        return
    from .live import live_block

    with live_block(stream) as show:
        yield show
