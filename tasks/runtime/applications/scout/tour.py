"""Finds a short tour through places."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

EXACT_PLACES = 9
"""Places up to which the shortest tour is found: twenty thousand sums; worlds have six rooms at most."""

Table = Sequence[Sequence[float]]


def plan_tour(distances: NDArray[np.float64]) -> list[int]:
    """Orders places into a short open tour from place 0.

    Few places are visited on the shortest tour (M. Held, R. M. Karp, "A dynamic programming approach to sequencing
    problems", 1962), many on one from nearest neighbour to nearest neighbour, untangled by 2-opt.

    Args:
        distances: shape (n, n), symmetric; infinite where there is no way.

    Returns:
        The places that can be reached from place 0, without it.
    """
    table = distances.tolist()
    places = [place for place in range(1, len(table)) if np.isfinite(table[0][place])]
    return _shortest(places, table) if len(places) <= EXACT_PLACES else _untangled(places, table)


def _shortest(places: list[int], table: Table) -> list[int]:
    """Grows the best tours over all sets of places, one place at a time."""
    if not places:
        return []
    # Length of the best tour through a set of places to the last of them, and that tour.
    best = {(1 << number, number): (table[0][place], [place]) for number, place in enumerate(places)}
    for _ in places[1:]:
        longer: dict[tuple[int, int], tuple[float, list[int]]] = {}
        for (visited, last), (length, tour) in best.items():
            for number, place in enumerate(places):
                if visited >> number & 1:
                    continue
                key, way = (visited | 1 << number, number), (length + table[places[last]][place], [*tour, place])
                if key not in longer or way < longer[key]:
                    longer[key] = way
        best = longer
    return min(best.values())[1]


def _untangled(places: list[int], table: Table) -> list[int]:
    """Goes to the nearest place left, then turns stretches around for as long as that shortens the tour."""
    left, tour = set(places), [0]
    while left:
        here = table[tour[-1]]
        nearest = min(left, key=lambda place: (here[place], place))
        left.remove(nearest)
        tour.append(nearest)
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
    return tour[1:]
