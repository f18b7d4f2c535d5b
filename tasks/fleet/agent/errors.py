"""What goes wrong on a robot, on purpose. A tree of its own: the agent imports nothing of the project."""

from __future__ import annotations

import errno

_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class AgentError(Exception):
    """Base of all; its text is for the person at the robot."""


class StepFailed(AgentError):
    """A step of a deployment failed, and repeating it would not help.

    Args:
        code: of the table in `failure_codes`.
        reason: what happened.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code
        self.reason = reason


class TryLater(AgentError):
    """The server cannot be reached, or cannot answer now; the same may work later."""


def disk_failure(error: OSError, doing: str) -> StepFailed:
    """What an error of the robot's own disk means: a full one is said plainly."""
    if error.errno in _NO_SPACE:
        return StepFailed("EnvironmentSetupError", f"the disk is full: {doing}")
    return StepFailed("EnvironmentSetupError", f"{doing}: {error.strerror or error}")
