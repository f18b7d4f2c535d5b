"""Planned numbers of trials: by what is assumed, by earlier runs, by worlds."""

from typing import Literal

import numpy as np
import pytest
from helpers.night_records import make_night
from scipy.special import bdtr, ndtri

from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.detection import (
    ASSUMED_SHARE,
    PlannedTrials,
    Question,
    liveliest_pairs,
    plan_pairs,
)
from prefect_robomaker.tasks.comparison.margins import margin_power, score
from prefect_robomaker.tasks.comparison.statistics.mcnemar import mcnemar_power


def nights(*letters: str) -> list[NightRun]:
    return [NightRun.of(make_night(each, number)) for number, each in enumerate(letters)]


def test_without_earlier_runs_a_fifth_is_assumed_and_said() -> None:
    found = plan_pairs(Question("difference", 0.1), PlannedTrials(40, 40), None)
    assert (found.pairs, found.more, found.planned) == (168, 128, 40)
    assert found.discordant == ASSUMED_SHARE
    assert "--differ says another share" in found.assumed[0]
    assert found.smallest == pytest.approx(0.2, abs=0.03)
    assert plan_pairs(Question("difference", found.smallest or 0), PlannedTrials(40, 40), None).more == 0


def test_what_is_given_counts_and_is_no_assumption() -> None:
    found = plan_pairs(Question("difference", 0.1, discordant=0.14), PlannedTrials(500, 500), None)
    assert (found.pairs, found.more, found.assumed) == (114, 0, [])


def test_the_liveliest_of_earlier_runs_is_taken() -> None:
    runs = nights("P" * 40, "P" * 38 + "FF", "P" * 30 + "F" * 10, "P" * 30 + "F" * 10)
    earlier = liveliest_pairs(runs)
    assert earlier is not None
    assert (earlier.runs, earlier.share) == ((runs[1].run_id, runs[2].run_id), 0.2)
    found = plan_pairs(Question("difference", 0.1), PlannedTrials(40, 40), earlier)
    assert found.pairs == 168
    assert f"20.0% of pairs differ, as between {runs[1].run_id} and {runs[2].run_id}, 40 pairs" in found.assumed[0]


@pytest.mark.parametrize("letters", [("P" * 40, "P" * 40), ("P" * 19, "F" * 19), ("P" * 40,)])
def test_runs_that_tell_nothing_are_not_taken(letters: tuple[str, ...]) -> None:
    assert liveliest_pairs(nights(*letters)) is None


def test_where_worlds_decide_they_are_counted() -> None:
    found = plan_pairs(Question("difference", 0.1), PlannedTrials(200, 20), None)
    assert found.worlds is not None
    assert (found.test, found.pairs) == ("sign flip of worlds", found.worlds * 10)
    assert any("10 trials in each world" in each for each in found.assumed)
    margin = plan_pairs(Question("margin", 0.1), PlannedTrials(200, 20), None)
    assert margin.test == "interval between worlds"


def test_of_few_worlds_pairs_decide() -> None:
    assert plan_pairs(Question("difference", 0.1), PlannedTrials(200, 5), None).test == "exact McNemar"


def test_what_only_a_run_can_tell_is_left_out() -> None:
    found = plan_pairs(Question("margin", 0.05), None, None)
    assert (found.planned, found.smallest, found.pairs) == (None, None, found.more)


def test_planned_pairs_have_the_power_that_is_said() -> None:
    """50 settings, each decided 20,000 times by the test that decides; one pair fewer has too little, exactly."""
    chance = np.random.default_rng(38)
    for number in range(50):
        kind: Literal["difference", "margin"] = "margin" if number % 2 else "difference"
        share = float(chance.uniform(0.04, 0.3))
        differ = float(chance.uniform(share, 0.6)) if kind == "difference" else float(chance.uniform(0.0, 0.6))
        alpha = float(chance.choice([0.01, 0.05, 0.1]))
        pairs = plan_pairs(Question(kind, share, alpha, differ), None, None).pairs
        gain = share if kind == "difference" else 0.0
        chances = [(differ - gain) / 2, (differ + gain) / 2, 1 - differ]
        worse, better, _ = chance.multinomial(pairs, chances, size=20_000).T
        if kind == "margin":
            shown = score(pairs, worse.astype(float), better.astype(float), share) >= -ndtri(alpha / 2)
            fewer = margin_power(pairs - 1, differ, share, alpha)
        else:
            shown = np.minimum(1, 2 * bdtr(np.minimum(worse, better), worse + better, 0.5)) <= alpha
            fewer = mcnemar_power(pairs - 1, differ, share, alpha)
        assert shown.mean() >= 0.8 - 3 * np.sqrt(0.16 / 20_000), (kind, share, differ, alpha, pairs)
        assert fewer < 0.8
