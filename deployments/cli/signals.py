"""Makes SIGTERM and SIGHUP end a command like Ctrl-C: running jobs are cancelled, and the summary is printed."""

import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

_NUMBERS = (signal.SIGTERM, signal.SIGHUP)
_SAME_S = 2.0
"""Time within which a signal is the one before: `timeout` sends it to the process and to its group."""


class Terminated(KeyboardInterrupt):
    """Raised when a signal (SIGTERM, SIGHUP) asks this process to end.

    Args:
        signal_number: The signal.
    """

    def __init__(self, signal_number: int) -> None:
        super().__init__()
        self.signal_number = signal_number


@contextmanager
def interrupted_by_signals(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Raises `Terminated` inside the `with` block on SIGTERM or SIGHUP, unless they are ignored.

    One that comes at once again is left alone, or it would end the writing of the report. The former handlers are set
    again at the end of the block.

    Args:
        clock: Function that returns seconds.
    """
    raised_s = -math.inf

    def end(number: int, frame: FrameType | None) -> None:
        nonlocal raised_s
        del frame
        if clock() - raised_s >= _SAME_S:
            raised_s = clock()
            raise Terminated(number)

    before = {number: signal.getsignal(number) for number in _NUMBERS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def die_of(number: int) -> NoReturn:
    """Ends this process by a signal, so that its parent sees the cause; it does not return."""
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    os._exit(128 + number)  # where the signal is blocked
