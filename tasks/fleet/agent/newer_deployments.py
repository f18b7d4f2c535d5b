"""Only deployments newer than the last one of this robot are carried out: orders are not signed, and may be old ones.

Each deployment document has a number, signed with it, which rises from deployment to deployment. Somebody who can send
orders, but not sign, could otherwise take the robot back to a version with known holes.
"""

from __future__ import annotations

from .deployment import Deployment, Version


def is_newer(deployment: Deployment, last_number: int) -> bool:
    """Whether a deployment is newer than the last one that was carried out here, and so may be.

    Args:
        deployment: The deployment of an order, with its verified document.
        last_number: Number of the last deployment that was finished on this robot; 0: there was none.
    """
    return deployment.number > last_number


def why_refused(deployment: Deployment, last_number: int, good: Version | None) -> str | None:
    """Returns the reason why a deployment that is not newer is refused.

    Args:
        deployment: The deployment of an order, for which `is_newer` is false.
        last_number: Number of the last deployment that was finished on this robot.
        good: The last version that proved healthy; absent: none did.

    Returns:
        `None` if this very deployment brought the good version, so that its order has been carried out already.
    """
    job = deployment.version.job
    if good is not None and good.job == job:
        return None
    reason = f"{job} has number {deployment.number}, and the robot has carried out number {last_number}"
    return f"{reason}: only newer deployments count"
