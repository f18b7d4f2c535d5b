"""Notes about a deployment, in words: its waits besides robots, and its rollback."""

from collections.abc import Iterator

from ....schemas.rollouts.standings import DeploymentStanding
from ....schemas.wire.arns import ResourceArn
from ..rollout.waits import in_words

_MOST_NAMES = 10


def notes_of(deployment: DeploymentStanding) -> Iterator[str]:
    """A sentence each; none where it only waits for robots."""
    if deployment.rolls_back is not None:
        yield f"brings robots back after {_short(deployment.rolls_back)} failed"
    for wait in deployment.waits:
        yield in_words(wait, deployment.job)
    if deployment.rollback_is_due:
        yield "robots that have the new version go back as soon as those that have begun have ended"
    back = deployment.rollback
    if back is None:
        return
    if back.jobs:
        yield f"robots go back by {', '.join(_short(job) for job in back.jobs)}"
    if back.robotsLeft:
        names = ", ".join(ResourceArn.parse(robot).name for robot in back.robotsLeft[:_MOST_NAMES])
        more = f" and {len(back.robotsLeft) - _MOST_NAMES:,} more" if len(back.robotsLeft) > _MOST_NAMES else ""
        yield f"no earlier version is known of {names}{more}"
    if back.reason:
        yield f"robots do not go back: {back.reason}"


def _short(job: str) -> str:
    return job.rpartition("/")[2]
