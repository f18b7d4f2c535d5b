"""Exceptions of the agent. They have a base class of their own: the agent imports nothing of the project."""

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
    """Describes a failed write to the robot's own disk as a failed step; a full disk is named as such."""
    if error.errno in _NO_SPACE:
        return StepFailed("EnvironmentSetupError", f"the disk is full: {doing}")
    return StepFailed("EnvironmentSetupError", f"{doing}: {error.strerror or error}")
