"""Forking a process that ends with this one, outside of a box."""

import os
from collections.abc import Callable
from typing import NoReturn

from ..limits.processes import die_with_parent


def fork_beside(become: Callable[[], NoReturn]) -> int:
    """Forks a process in a session of its own, which dies with this process.

    Args:
        become: What it does; it must not return.

    Returns:
        Its pid.
    """
    parent = os.getpid()
    pid = os.fork()
    if pid == 0:
        try:
            os.setsid()
            die_with_parent()
            if os.getppid() == parent:
                become()
        finally:
            os._exit(1)
    return pid
