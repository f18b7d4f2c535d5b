"""The order in which a batch that may end early makes jobs of its requests."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.jobs.request_order import mixed_order


def requests(worlds: list[int]) -> list[dict[str, Any]]:
    return [{"simulationApplications": [{"worldConfigs": [{"world": f"world/{world}"}]}]} for world in worlds]


@given(st.lists(st.integers(0, 12), max_size=60))
def test_all_requests_come_once_and_the_order_depends_on_nothing_but_the_worlds(worlds: list[int]) -> None:
    order = mixed_order(requests(worlds))
    assert sorted(order) == list(range(len(worlds)))
    named_otherwise = requests([100 + world for world in worlds])
    assert mixed_order([{**each, "seed": 4} for each in named_otherwise]) == order


def test_easy_requests_that_are_written_first_are_not_run_first() -> None:
    order = mixed_order([{} for _ in range(100)])
    assert 30 <= sum(place < 50 for place in order[:50]) - sum(place < 50 for place in order[50:]) + 50 <= 70


def test_requests_of_a_world_stay_together_where_whole_worlds_are_compared() -> None:
    worlds = [number % 10 for number in range(40)]
    ran = [worlds[place] for place in mixed_order(requests(worlds))]
    assert all(len(set(ran[start : start + 4])) == 1 for start in range(0, 40, 4))
    assert ran != sorted(ran)
    few = [number // 20 for number in range(40)]
    mixed = [few[place] for place in mixed_order(requests(few))]
    assert set(mixed[:10]) == {0, 1}
