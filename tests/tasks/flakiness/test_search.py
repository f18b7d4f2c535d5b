"""Searches in jobs that are made up: what decides is known, and each rerun costs nothing."""

import random
from collections import Counter
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.verification import FACTORS, Factor
from prefect_robomaker.tasks.flakiness.causes import UNUSED, VALUED, Held, Hold, Weights
from prefect_robomaker.tasks.flakiness.evidence import Evidence, Observation, sets_of
from prefect_robomaker.tasks.flakiness.search import MOST_RERUNS, QUIET, Found, search

MOST = MOST_RERUNS - 2
"""Reruns of a search, as two are kept for replays."""
APART: tuple[Factor, ...] = ("seed", "time", "threads", "hash", "network")
"""Factors of which none is held by holding another."""
ALL_USED: Weights = dict.fromkeys(APART, 1.0)
IsFree = Callable[[Held], bool]


def holding(*factors: Factor) -> Held:
    """The set of factors that a rerun holds."""
    return frozenset(factors)


def used(*factors: Factor) -> Weights:
    """Weights where these factors were seen to be used; hashes always are."""
    return {each: 1.0 if each in (*factors, "hash") else UNUSED for each in APART}


def searched(
    is_free: IsFree, seed: int, weights: Weights = ALL_USED, *, chance: float = 0.5, noise: IsFree = lambda _: False
) -> Found:
    """A search in a job that fails by chance where it is free; `noise`: no two of its ways are then the same."""
    draw = random.Random(seed)

    def try_out(hold: Hold) -> list[Observation]:
        held, values = hold
        verdict = "FAIL" if is_free(held) and draw.random() < chance else "PASS"
        return [Observation(held, verdict, f"{verdict} {draw.random() if noise(held) else ''}", values)]

    return search(try_out, lambda: weights, MOST, try_out(Hold(frozenset()))[0])


@pytest.mark.parametrize("factor", APART)
def test_the_factor_that_decides_is_named_among_two_that_are_used(factor: Factor) -> None:
    found = searched(lambda held: factor not in held, 1, used(factor, "threads"))
    assert found.decision is not None
    assert found.decision.factor == factor
    assert len(found.observations) <= MOST + 1


def test_noise_of_one_factor_leaves_the_verdict_to_another() -> None:
    decided: Counter[Factor | None] = Counter()
    for seed in range(3):
        draw = random.Random(seed)

        def try_out(hold: Hold, draw: random.Random = draw, seed: int = seed) -> list[Observation]:
            order = random.Random(f"{seed} {dict(hold.values).get('hash', 0)}") if "hash" in hold.held else draw
            verdict = "FAIL" if order.random() < 0.5 else "PASS"
            return [
                Observation(
                    hold.held, verdict, f"{verdict} {draw.random() if 'seed' not in hold.held else ''}", hold.values
                )
            ]

        found = search(try_out, lambda: used("seed"), MOST, try_out(Hold(frozenset()))[0])
        decided[found.decision.factor if found.decision else None] += 1
    assert set(decided) <= {"hash", None}
    assert decided["hash"] >= 2


def test_a_job_that_no_factor_holds_is_not_decided() -> None:
    found = searched(lambda _: True, 1)
    assert (found.decision, found.why_not) == (None, "it flips also while everything is held that can be")


def test_two_factors_that_both_bring_chance_are_no_single_one() -> None:
    is_free: IsFree = lambda held: not held >= {"seed", "time"}  # noqa: E731
    found = searched(is_free, 1, used("seed", "time"), noise=is_free)
    assert found.decision is None
    assert found.why_not == "two factors decide together: randomness that no seed repeats and the clock of the programs"


def test_where_either_of_two_holds_a_job_none_is_named() -> None:
    """Each would be named if no rerun had held the other."""
    assert searched(lambda held: not held & {"hash", "threads"}, 1, used("threads")).decision is None


def test_a_job_that_repeats_is_run_until_that_is_certain() -> None:
    found = searched(lambda _: False, 0)
    assert (found.repeats, found.decision, len(found.observations)) == (True, None, QUIET)


def test_other_reruns_than_the_run_are_no_repeating() -> None:
    same = Observation(frozenset(), "PASS", "b")
    found = search(lambda _: [same], lambda: ALL_USED, MOST, first=Observation(frozenset(), "FAIL", "a"))
    assert (found.repeats, found.decision) == (False, None)


@settings(max_examples=8)
@given(st.floats(0.1, 0.9), st.integers(0, 1000), st.integers(8, MOST_RERUNS))
def test_a_search_keeps_to_its_reruns(chance: float, seed: int, most: int) -> None:
    draw = random.Random(seed)
    found = search(lambda hold: [Observation(hold.held, str(draw.random() < chance), "")], lambda: used(), most)
    assert len(found.observations) <= most


def test_a_flip_while_a_factor_is_held_rules_it_out() -> None:
    held: Held = holding("hash", "time")
    seen = [Observation(held, verdict, verdict) for verdict in ("PASS", "FAIL")]
    chances = Evidence(seen, ALL_USED).of_factors()
    assert max(chances[holding("hash")], chances[holding("time")], chances[held]) < 1e-3
    assert chances[holding("seed")] > 0.1


def test_a_network_is_held_with_the_ports_and_files_that_it_holds() -> None:
    """Reruns without a network would not flip if files decide, though these count as free."""
    weights = dict.fromkeys(FACTORS, 1.0)
    sets = sets_of(weights, Evidence([], weights))
    assert all(each >= {"network", "files", "order"} for each in sets if "network" in each)
    assert any("files" in each and "network" not in each for each in sets)


def test_held_addresses_differ_by_what_else_is_held_and_still_repeat() -> None:
    """Code that holds the clock takes memory: with it, a robot that asks for an address goes another way."""
    ends: dict[Held, str] = {holding("hash"): "FAIL", holding("hash", "time"): "PASS"}
    seen = [Observation(held, end, end) for held, end in ends.items() for _ in range(3)]
    of_hash = Evidence(seen, used("time")).of_factors()[holding("hash")]
    assert of_hash > 0.01
    other = Observation(holding("hash"), "PASS", "PASS")
    assert Evidence([*seen, other], used("time")).of_factors()[holding("hash")] < 1e-3


def test_factors_that_programs_never_hold_cost_no_reruns() -> None:
    """Programs in other languages leave the clock and hashes free, also where a rerun is to hold them."""
    draw = random.Random(1)

    def try_out(hold: Hold) -> list[Observation]:
        held = hold.held
        end = "FAIL" if "network" not in held and draw.random() < 0.5 else "PASS"
        return [Observation(held & {"order", "files", "network"}, end, end)]

    found = search(try_out, lambda: ALL_USED, MOST)
    assert found.decision is not None
    assert found.decision.factor == "network"


def test_where_nothing_can_be_held_no_reruns_are_spent_on_it() -> None:
    ways = iter(range(MOST))
    found = search(lambda _: [Observation(frozenset(), "PASS", str(next(ways)))], lambda: ALL_USED, MOST)
    assert (found.decision, found.why_not) == (None, "none of what may decide can be held here")
    assert len(found.observations) < MOST


@pytest.mark.parametrize("factor", sorted(VALUED))
def test_another_value_is_tried_where_held_ends_are_as_usual(factor: Factor) -> None:
    """Held at 0, the job ends as in three of four free reruns: that it repeats so would tell next to nothing."""
    decided = 0
    for seed in range(3):
        draw = random.Random(seed)

        def try_out(hold: Hold, draw: random.Random = draw) -> list[Observation]:
            is_rare = dict(hold.values).get(factor, 0) == 1 if factor in hold.held else draw.random() < 0.25
            end = "FAIL" if is_rare else "PASS"
            return [Observation(hold.held, end, end, hold.values)]

        found = search(try_out, lambda: used(factor), MOST, Observation(frozenset(), "FAIL", "FAIL"))
        decided += found.decision is not None and found.decision.factor == factor
    assert decided == 3
