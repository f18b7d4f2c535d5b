"""Delays signals (Ctrl-C, SIGTERM) until a block of code is done."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_STOPS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def held_signals() -> Iterator[None]:
    """Delays Ctrl-C and SIGTERM until the end of the `with` block.

    It is for imports of packages that catch `BaseException` around imports of optional packages, as trimesh does: an
    interruption there would be taken for a missing package, and the program would go on. Only the main thread gets
    signals; in others this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in _STOPS}
    for number in _STOPS:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            # None: something else than Python handles it, and has to be left alone from here on.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for number in came:
            signal.raise_signal(number)
