"""Order in which a batch creates jobs of its requests, mixed as a comparison may end the batch early."""

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from ...schemas.reports.live_comparison import FEWEST_WORLDS
from ..simulations.planning.run_plans import world_arn


def mixed_order(requests: Sequence[Mapping[str, Any]]) -> list[int]:
    """Mixes requests in a fixed pseudo-random order, so that easy ones are not all first.

    If there are enough worlds to compare whole ones, the requests of a world stay together: such a world counts when
    the last of its jobs has ended.

    Args:
        requests: Requests for simulation jobs on the wire.

    Returns:
        Indices of all requests; the first one becomes a job first.
    """
    worlds = [world_arn(request) or "" for request in requests]
    first: dict[str, int] = {}
    for place, world in enumerate(worlds):
        first.setdefault(world, place)
    if len(first) < FEWEST_WORLDS:
        return sorted(range(len(requests)), key=_drawn)
    return sorted(range(len(requests)), key=lambda place: (_drawn(first[worlds[place]]), place))


def _drawn(place: int) -> str:
    """Returns a pseudo-random sort key for a request's index, the same in every process."""
    return hashlib.sha256(str(place).encode()).hexdigest()
