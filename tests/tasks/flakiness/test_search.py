"""Searches in jobs that are made up: what decides is known, and each rerun costs nothing."""

import random
from collections import Counter
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.verification import FACTORS, Factor
from prefect_robomaker.tasks.flakiness.evidence import Held, Observation, posterior
from prefect_robomaker.tasks.flakiness.search import MOST_RERUNS, Found, search

SEEDS = 12
WEIGHTS = dict.fromkeys(FACTORS, 1.0)
IsFree = Callable[[Held], bool]


def searched(is_free: IsFree, seed: int, *, chance: float = 0.5, bits: bool = True) -> Found:
    """A search in a job that fails by chance where it is free; `bits`: no two of its ways are then the same."""
    draw = random.Random(seed)

    def try_out(held: Held) -> list[Observation]:
        verdict = "FAIL" if is_free(held) and draw.random() < chance else "PASS"
        return [Observation(held, verdict, f"{verdict} {draw.random() if is_free(held) and bits else ''}")]

    return search(try_out, lambda: WEIGHTS)


@pytest.mark.parametrize("factor", FACTORS)
def test_the_factor_that_decides_is_named(factor: Factor) -> None:
    found = [searched(lambda held: factor not in held, seed) for seed in range(4)]
    named = [each.decision.factor for each in found if each.decision]
    assert set(named) == {factor}
    assert len(named) >= len(found) - 1


def test_where_only_two_ways_are_known_nothing_wrong_is_named() -> None:
    found = [searched(lambda held: "time" not in held, seed, bits=False).decision for seed in range(SEEDS)]
    named = Counter(each.factor if each else None for each in found)
    assert set(named) <= {"time", None}
    assert named["time"] >= SEEDS // 2


def test_a_job_that_no_factor_holds_is_not_decided() -> None:
    found = [searched(lambda held: True, seed) for seed in range(SEEDS)]
    # Of such jobs one in twenty may get a wrong answer.
    assert sum(each.decision is not None for each in found) <= 2
    assert {each.why_not for each in found if not each.decision} <= {
        "it flips also while everything is held that can be",
        "no factor alone holds it",
    }


def test_factors_that_programs_never_hold_cost_no_reruns() -> None:
    """Programs in other languages leave the clock and hashes free, also where a rerun is to hold them."""
    outside: Held = frozenset({"order", "files", "network"})
    draw = random.Random(1)

    def try_out(held: Held) -> list[Observation]:
        end = "FAIL" if "network" not in held and draw.random() < 0.5 else "PASS"
        return [Observation(held & outside, end, f"{end} {draw.random() if 'network' not in held else ''}")]

    found = search(try_out, lambda: WEIGHTS)
    assert found.decision is not None
    assert (found.decision.factor, len(found.observations) < MOST_RERUNS) == ("network", True)


def test_a_search_that_held_nothing_says_nothing_of_what_is_held() -> None:
    ways = iter(range(MOST_RERUNS))
    found = search(lambda held: [Observation(held, "PASS", str(next(ways)))], lambda: WEIGHTS, 7)
    assert (found.decision, found.why_not) == (None, "7 reruns did not tell")


def test_where_either_of_two_holds_a_job_none_is_named() -> None:
    """Each would be `decided` if no rerun had held all the others."""
    found = [searched(lambda held: not held & {"order", "network"}, seed) for seed in range(SEEDS // 4)]
    assert all(each.decision is None for each in found)


def test_a_job_that_repeats_is_run_eight_times() -> None:
    found = searched(lambda held: False, 0)
    assert (found.repeats, found.decision, len(found.observations)) == (True, None, 8)


def test_other_reruns_than_the_run_are_no_repeating() -> None:
    same = Observation(frozenset(), "PASS", "b")
    found = search(lambda held: [same], lambda: WEIGHTS, first=Observation(frozenset(), "FAIL", "a"))
    assert (found.repeats, found.decision) == (False, None)


@given(st.floats(0.1, 0.9), st.integers(0, 1000), st.integers(8, MOST_RERUNS))
def test_a_search_keeps_to_its_reruns(chance: float, seed: int, most: int) -> None:
    draw = random.Random(seed)
    found = search(lambda held: [Observation(held, str(draw.random() < chance), "")], lambda: WEIGHTS, most)
    assert len(found.observations) <= most


def test_a_flip_while_a_factor_is_held_rules_it_out() -> None:
    held: Held = frozenset({"hash", "time"})
    seen = [Observation(held, verdict, verdict) for verdict in ("PASS", "FAIL")]
    chances = posterior(seen, "verdict", WEIGHTS)
    assert (chances["hash"], chances["time"]) == (0.0, 0.0)
    assert chances["seed"] > 0.1
