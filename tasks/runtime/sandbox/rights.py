"""Rights that a process gives up before it runs code of a job."""

from collections.abc import Sequence

from ....schemas.runs.programs import BoxLevel
from . import kernel
from .landlock import Rules, restrict
from .system_calls import filter_system_calls


def give_up_rights(level: BoxLevel, rules: Sequence[Rules] = ()) -> None:
    """Confines this process and all that it starts, for good.

    Args:
        level: `box`: it is in one already, and gives up what it could do to it; `landlock`: it gets rules; `none`.
        rules: for `landlock`.
    """
    if level == "none":
        return
    kernel.leave_keyrings()
    kernel.forgo_privileges()
    if level == "landlock":
        restrict(rules)
    kernel.stay_visible()
    filter_system_calls()
