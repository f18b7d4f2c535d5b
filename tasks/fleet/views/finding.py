"""Finding the fleet or deployment that a person names."""

from collections.abc import Iterator

from ....schemas.lifecycles import is_terminal
from ....schemas.wire.arns import ResourceArn
from ....schemas.wire.errors import InvalidParameterException
from ...catalog import Resource
from ...service.service import Service
from ..records import DEPLOYMENT, FLEET, last_deployment

_PAGE = 100


def fleets(service: Service) -> Iterator[Resource]:
    """All fleets, newest first."""
    after = None
    while True:
        page = service.catalog.list(FLEET, limit=_PAGE, after=after)
        yield from page.resources
        if (after := page.next_token) is None:
            return


def find_fleet(fleet: str, service: Service) -> Resource:
    """The fleet of a name or an ARN.

    Raises:
        InvalidParameterException: there is none of that name, or the ARN names something else.
        ResourceNotFoundException: there is none of that ARN.
    """
    if fleet.startswith("arn:"):
        ResourceArn.parse(fleet, FLEET)
        return service.catalog.get(fleet, kind=FLEET)
    if (found := service.catalog.find(FLEET, fleet)) is None:
        raise InvalidParameterException(
            f"there is no fleet named {fleet!r}; `robomaker fleet status` lists those there are"
        )
    return found


def find_deployment(named: str | None, service: Service) -> Resource:
    """The deployment job of an ARN; the latest of a fleet, by the fleet's name or ARN; or the only one that goes on.

    Args:
        named: what was named; nothing: the one that goes on.
        service: where it is stored.

    Raises:
        InvalidParameterException: nothing has that name, the fleet has had no deployment, or not exactly one goes on.
        ResourceNotFoundException: there is nothing of that ARN.
    """
    if named is None:
        return _only_one(service)
    if named.startswith("arn:") and ResourceArn.parse(named, FLEET, DEPLOYMENT).kind == DEPLOYMENT:
        return service.catalog.get(named, kind=DEPLOYMENT)
    fleet = find_fleet(named, service)
    if (found := last_deployment(fleet.arn, service)) is None:
        raise InvalidParameterException(f"fleet {fleet.name!r} has had no deployment; CreateDeploymentJob makes one")
    return found


def _only_one(service: Service) -> Resource:
    latest = [last_deployment(fleet.arn, service) for fleet in fleets(service)]
    found = [job for job in latest if job is not None and not is_terminal(DEPLOYMENT, job.status)]
    if len(found) == 1:
        return found[0]
    if not found:
        raise InvalidParameterException("no deployment goes on; name a fleet, or the ARN of a deployment")
    names = ", ".join(sorted(ResourceArn.parse(str(job.parent)).name for job in found))
    raise InvalidParameterException(f"deployments to {len(found)} fleets go on: {names}; name one of them")
