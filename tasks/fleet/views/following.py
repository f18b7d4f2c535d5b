"""Following a deployment to its end, by looking into the catalog again and again."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from ....schemas.lifecycles import is_terminal
from ....schemas.rollouts.rollout import Rollout
from ...catalog import Resource
from ...service.service import Service
from ..records import DEPLOYMENT, rollout_of
from ..rollout.waves import waves_of

LOOK_S = 1.0
"""How often it is looked."""


@dataclass(frozen=True)
class Look:
    """A deployment at one moment."""

    job: Resource
    at_s: float
    """When it was looked, in seconds since the epoch."""

    rollout: Rollout | None = None
    """How each robot stands; nothing: it has not begun."""

    waves: Sequence[tuple[str, ...]] = ()
    """ARNs of the robots of each wave."""

    @property
    def has_ended(self) -> bool:
        """Whether it has come to its end."""
        return is_terminal(DEPLOYMENT, self.job.status)


def follow(job: Resource, service: Service, sleep: Callable[[float], object]) -> Iterator[Look]:
    """Looks at a deployment until it has ended; the last look is at its end.

    Args:
        job: the deployment job.
        service: where it is stored.
        sleep: waits, in seconds.

    Raises:
        ResourceNotFoundException: it was deleted.
        ServiceUnavailableException: the catalog does not answer.
    """
    look, revision = _look(job, service), None
    while True:
        yield look
        if look.has_ended:
            return
        sleep(LOOK_S)
        job = service.catalog.get(job.arn)
        now = service.catalog.open_rollouts(str(job.parent)).get(job.arn)
        if now is None or now != revision or is_terminal(DEPLOYMENT, job.status):
            look, revision = _look(job, service), now
        else:
            look = Look(job, service.clock().timestamp(), look.rollout, look.waves)


def _look(job: Resource, service: Service) -> Look:
    rollout, at_s = rollout_of(job.arn, service), service.clock().timestamp()
    return Look(job, at_s) if rollout is None else Look(job, at_s, rollout, waves_of(rollout.plan))
