"""Strongest sandbox level that this machine allows this user, found by trying."""

import os
from collections.abc import Callable
from typing import NamedTuple, NoReturn

from ....schemas.runs.programs import BoxLevel
from ..limits.processes import adopt_orphans
from .box import Box, BoxError, fork_beside
from .kernel import Rules, confine, landlock_version
from .visible_files import Sight, system_sights


class Confinement(NamedTuple):
    """The strongest sandbox level that this machine supports, and why not a stronger one."""

    level: BoxLevel
    why_not_more: str = ""
    """Reasons why the stronger levels do not work, as text."""


def strongest_level() -> Confinement:
    """Tries the sandbox levels, strongest first, and returns the first that works on this machine, for this user.

    The result also says why stronger levels do not work. This process adopts orphaned descendants from then on.
    """
    adopt_orphans()
    system_sights()  # looked for once, and known to all that is forked from this process
    try:
        _try_box()
    except OSError as error:
        refused = f"no namespaces: {error}"
    else:
        return Confinement("box")
    if landlock_version() == 0:
        return Confinement("none", f"{refused}; no Landlock: this kernel does not have it, or has it switched off")
    if _exit_code(fork_beside(_leaving(lambda: confine("landlock", [Rules("/usr", writable=False)])))) == 0:
        return Confinement("landlock", refused)
    return Confinement("none", f"{refused}; no Landlock: the kernel refused its rules")


def _try_box() -> None:
    box = Box()
    try:
        box.furnish([Sight("/usr", "read")], "none")
        if _exit_code(box.fork(_leaving(lambda: confine("box")))) != 0:
            raise BoxError("a process in it could not give up its rights")
    finally:
        box.close()


def _leaving(action: Callable[[], None]) -> Callable[[], NoReturn]:
    def become() -> NoReturn:
        code = 1
        try:
            action()
            code = 0
        finally:
            os._exit(code)

    return become


def _exit_code(pid: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


if __name__ == "__main__":
    import json
    import sys

    json.dump(strongest_level()._asdict(), sys.stdout)
