"""Calls a function for many items in threads."""

from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

WORKERS = 8
"""Transfers at once, of whatever size."""

WORKERS_FOR_SMALL = 32
"""Small files at once: a server that has to wait for the next one spends a third more of its processors on each."""


def run_all(call: Callable[[Item], Result], items: Iterable[Item], workers: int = WORKERS) -> list[Result]:
    """Calls `call` for every item in threads and returns the results in the items' order.

    After a failure nothing new is started; what runs is waited for, then the failure of the earliest
    item is raised.

    Args:
        call: what to call.
        items: for what.
        workers: how many threads.
    """
    with ThreadPoolExecutor(workers, thread_name_prefix="storage") as pool:
        futures = [pool.submit(call, item) for item in items]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
        finally:
            for future in futures:
                future.cancel()
    # Only what had not begun is cancelled, and only because something else failed: that one is raised here.
    for future in futures:
        if not future.cancelled():
            future.result()
    return [future.result() for future in futures]
