import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.applications.scout.agent import plan_tour

spots = st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), min_size=1, max_size=6, unique=True)


def length(tour: list[int], distances: np.ndarray) -> float:
    return sum(distances[a, b] for a, b in itertools.pairwise([0, *tour]))


def distances_between(places: list[tuple[int, int]]) -> np.ndarray:
    points = np.array(places, dtype=float)
    return np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))


@given(spots)
def test_few_places_are_visited_on_the_shortest_tour(places: list[tuple[int, int]]) -> None:
    distances = distances_between(places)
    tour = plan_tour(distances)
    assert sorted(tour) == list(range(1, len(places)))
    best = min(length(list(order), distances) for order in itertools.permutations(range(1, len(places))))
    assert length(tour, distances) <= best + 1e-9


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), min_size=11, max_size=20, unique=True))
def test_many_places_are_visited_once_and_no_stretch_is_better_turned_around(places: list[tuple[int, int]]) -> None:
    distances = distances_between(places)
    tour = plan_tour(distances)
    assert sorted(tour) == list(range(1, len(places)))
    for first, last in itertools.combinations(range(len(tour)), 2):
        turned = [*tour[:first], *reversed(tour[first : last + 1]), *tour[last + 1 :]]
        assert length(turned, distances) >= length(tour, distances) - 1e-6


def test_leaves_out_what_cannot_be_reached() -> None:
    distances = np.array([[0, 1, np.inf, 5], [1, 0, np.inf, 4], [np.inf, np.inf, 0, np.inf], [5, 4, np.inf, 0]])
    assert plan_tour(distances) == [1, 3]
