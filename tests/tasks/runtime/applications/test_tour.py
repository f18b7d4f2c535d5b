import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.applications.tour import plan_tour

spots = st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), min_size=1, max_size=6, unique=True)


def length(tour: list[int], distances: np.ndarray) -> float:
    return sum(distances[a, b] for a, b in itertools.pairwise([0, *tour]))


@given(spots)
def test_visits_everything_once_and_not_much_farther_than_the_best_tour(places: list[tuple[int, int]]) -> None:
    points = np.array(places, dtype=float)
    distances = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    tour = plan_tour(distances)
    assert sorted(tour) == list(range(1, len(places)))
    best = min(length(list(order), distances) for order in itertools.permutations(range(1, len(places))))
    assert length(tour, distances) <= 1.35 * best + 1e-9


def test_leaves_out_what_cannot_be_reached() -> None:
    distances = np.array([[0, 1, np.inf, 5], [1, 0, np.inf, 4], [np.inf, np.inf, 0, np.inf], [5, 4, np.inf, 0]])
    assert plan_tour(distances) == [1, 3]
