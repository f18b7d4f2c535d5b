"""The order in which to visit places."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def plan_tour(distances: NDArray[np.float64]) -> list[int]:
    """Orders places into a short open tour from place 0: nearest neighbour, then 2-opt.

    Args:
      distances: shape (n, n), symmetric; infinite where there is no way.

    Returns:
      The places that can be reached from place 0, without it.
    """
    table = distances.tolist()
    left = {place for place in range(1, len(table)) if np.isfinite(table[0][place])}
    tour = [0]
    while left:
        here = table[tour[-1]]
        nearest = min(left, key=lambda place: (here[place], place))
        left.remove(nearest)
        tour.append(nearest)
    return _untangle(tour, table)[1:]


def _untangle(tour: list[int], table: Sequence[Sequence[float]]) -> list[int]:
    """Turns stretches around for as long as that shortens the tour; its first place stays."""
    improved = True
    while improved:
        improved = False
        for first in range(1, len(tour) - 1):
            for last in range(first + 1, len(tour)):
                before = table[tour[first - 1]][tour[first]]
                after = table[tour[first - 1]][tour[last]]
                if last + 1 < len(tour):
                    before += table[tour[last]][tour[last + 1]]
                    after += table[tour[first]][tour[last + 1]]
                if after < before - 1e-9:
                    tour[first : last + 1] = tour[first : last + 1][::-1]
                    improved = True
    return tour
