"""Calls a function for many items in threads."""

from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

WORKERS = 8
"""Transfers at once: more gains nothing against one server, fewer leaves it idle between small files."""


def run_all(call: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Calls `call` for every item in threads and returns the results in the items' order.

    After a failure nothing new is started; what runs is waited for, then the failure of the earliest
    item is raised.
    """
    with ThreadPoolExecutor(WORKERS, thread_name_prefix="storage") as pool:
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
