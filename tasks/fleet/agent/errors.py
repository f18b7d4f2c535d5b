"""Exceptions of the robot agent, with a base class of their own, as the agent imports nothing of the project."""

from __future__ import annotations

import errno

_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class AgentError(Exception):
    """Base class of the agent's errors; the text is for a person at the robot."""


class StepFailed(AgentError):
    """Raised when a step of a deployment failed and repeating it would not help.

    Args:
        code: Failure code in the table `NUMBERS`.
        reason: Text of the failure.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code
        self.reason = reason


class TryLater(AgentError):
    """Raised when the server cannot be reached or answer now; a retry may succeed."""


def disk_failure(error: OSError, doing: str) -> StepFailed:
    """Converts a write error of the robot's disk to a failed step."""
    if error.errno in _NO_SPACE:
        return StepFailed("EnvironmentSetupError", f"the disk is full: {doing}")
    return StepFailed("EnvironmentSetupError", f"{doing}: {error.strerror or error}")


NUMBERS = {
    "ResourceNotFound": 1001,  # the store has no such file: 404
    "EnvironmentSetupError": 1002,  # disk full, no such user, no sandbox, the launch file cannot be started
    "EtagMismatch": 1003,  # length or hash is not the one that was signed
    "RobotDeploymentAborted": 1004,  # TUF refused, or the new version was unhealthy and the robot went back
    "ExtractingBundleFailure": 1005,  # a bad archive
    "PreLaunchFileFailure": 1006,
    "PostLaunchFileFailure": 1007,
    "BadPermissionError": 1008,  # the store denies the file: 403
    "DownloadConditionFailed": 1009,
}
"""Number of each failure code in messages to the server (`DeploymentJobErrorCode`)."""

NAMES = {number: name for name, number in NUMBERS.items()}
"""Failure code of a deployment by its number on the wire."""
