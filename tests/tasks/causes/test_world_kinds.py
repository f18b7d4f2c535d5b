"""Kinds of worlds are compared by their worlds, so that one hard world is no hard kind."""

import numpy as np
import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.causes.evidence import Evidence, Signature, evidence_of
from prefect_robomaker.tasks.causes.groups import Group, groups_of
from prefect_robomaker.tasks.causes.world_kinds import hardest_kind, kind_codes

from .conftest import Row, table_of


def evidence(rates: list[float], chance: np.random.Generator, names: list[str] | None = None) -> Evidence:
    names = names or [f"{'dense' if each < len(rates) // 2 else 'sparse'} flat {each}" for each in range(len(rates))]
    rows: list[Row] = [
        {"world": world, "world_name": names[world], "outcome": "failed" if chance.random() < rate else "passed"}
        for world, rate in enumerate(rates)
        for _ in range(12)
    ]
    rows[0]["outcome"] = "failed"
    return evidence_of(table_of(rows))


def group(found: Evidence) -> Group:
    return groups_of(found)[0]


def test_the_harder_kind_is_found() -> None:
    found = evidence([0.7] * 5 + [0.1] * 5, np.random.default_rng(1))
    kind = hardest_kind(found, group(found))
    assert kind is not None
    name, mask, p_value = kind
    assert (name, int(mask.sum())) == ("dense flat", 60)
    assert p_value < 0.001


@pytest.mark.parametrize("spread", [0.0, 1.5])
def test_by_chance_no_kind_is_harder(spread: float) -> None:
    """Worlds differ by some logits, their kinds do not."""
    chance = np.random.default_rng(2)
    found = evidence([0.5] * 8, chance)
    everyone = np.ones(len(found), dtype=np.bool_)
    small = 0
    for _ in range(400):
        rates = 1 / (1 + np.exp(-chance.normal(-0.5, spread, 8)))
        failed = chance.random(len(found)) < rates[found.worlds]
        kind = hardest_kind(found, Group(Signature("polite"), failed, everyone))
        small += kind is not None and kind[2] <= 0.05
    assert small <= 30, "2.3 standard errors above 5 %"


def test_worlds_of_one_kind_and_few_worlds_have_no_kinds_to_compare() -> None:
    chance = np.random.default_rng(3)
    for names in ([f"flat {each}" for each in range(8)], ["a 1", "a 2", "b 1", "b 2"]):
        found = evidence([0.5] * len(names), chance, names)
        assert kind_codes(found)[1] == ()
        assert hardest_kind(found, group(found)) is None


def test_worlds_that_two_jobs_made_are_of_the_kind_of_their_template() -> None:
    """Names that two jobs share have the id of the job behind them, and others have none."""
    twice = [f"flat {each}{maker}" for each in (1, 2, 3) for maker in (" (generation-8285)", " (generation-01ab) (2)")]
    found = evidence([0.5] * 8, np.random.default_rng(3), [*twice, "flat 4", "flat 5"])
    assert kind_codes(found)[1] == ()
    rooms = [f"Lab (wing-{side}) {each}" for side in ("east", "west") for each in range(4)]
    found = evidence([0.5] * 8, np.random.default_rng(3), rooms)
    assert kind_codes(found)[1] == ("Lab (wing-east)", "Lab (wing-west)")


@examples(30)
@given(st.lists(st.sampled_from(["a", "b", "c", ""]), min_size=1, max_size=9), st.integers(0, 99))
def test_any_worlds_have_an_answer(kinds: list[str], seed: int) -> None:
    chance = np.random.default_rng(seed)
    names = [f"{kind} {number}".strip() for number, kind in enumerate(kinds)]
    found = evidence(chance.random(len(names)).tolist(), chance, names)
    kind = hardest_kind(found, group(found))
    assert kind is None or (0 <= kind[2] <= 1 and kind[1].any() and not kind[1].all())
