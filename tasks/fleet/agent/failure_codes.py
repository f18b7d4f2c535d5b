"""Numbers of the failure codes that an agent can say: `status.code` of the feedback that closes its order.

Servers and agents of other releases know these numbers, so they never change.
"""

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
"""Number by failure code, as on the wire (`DeploymentJobErrorCode`)."""

NAMES = {number: name for name, number in NUMBERS.items()}
"""Failure code by number."""
