"""Random fleets: the product's rollout and a model by brute force agree on every robot, in every second."""

import random

import pytest
from helpers.examples import examples
from helpers.rollout_ledger import LedgerService, plan_of
from helpers.rollout_model import RolloutModel
from helpers.rollout_robots import CODES, Attempt, Script, watch
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    Approved,
    Departure,
    Paused,
    Resumed,
    RobotGone,
    RolloutEvent,
    StopCause,
    Stopped,
)
from prefect_robomaker.schemas.wire.base import choices

ROBOT_TIMEOUT_S, JOB_TIMEOUT_S, SECONDS = 12, 70, 90


def random_attempt(rng: random.Random, quality: float) -> Attempt:
    """One attempt; of a quality of 1, it succeeds at once."""
    if rng.random() < quality:
        return Attempt(end_s=rng.choice([1, 3, 8]))
    return Attempt(
        fetch_s=None if rng.random() < 0.1 else rng.choice([1, 1, 2, 5, 11, 12, 13]),
        end=rng.choice(["success", "success", "success", None, rng.choice(CODES)]),
        end_s=rng.choice([1, 2, 3, 8, 11, 12, 13, 16]),
        reports=((1, "Validating", None), (2, "DownloadingExtracting", rng.choice([10.0, 50.0]))),
        cancel=rng.choice(["give up", "give up", "refuse", "ignore"]),
        cancel_s=rng.choice([1, 2, 6]),
    )


def random_script(rng: random.Random, quality: float) -> Script:
    begin = rng.randrange(SECONDS)
    off = ((begin, begin + rng.randrange(1, 40)),) if rng.random() < 0.2 else ()
    return Script(tuple(random_attempt(rng, quality) for _ in range(rng.choice([1, 1, 2, 3]))), off)


def random_people(rng: random.Random, names: list[str]) -> dict[int, list[RolloutEvent]]:
    people: dict[int, list[RolloutEvent]] = {}
    for _ in range(rng.choice([0, 1, 2])):  # also where it is not asked for, or too early
        people.setdefault(rng.randrange(SECONDS), []).append(Approved())
    for _ in range(rng.choice([0, 0, 1, 2, 4])):
        what = rng.choice(["gone", "gone", "pause", "pause", "stop"])
        second = rng.randrange(SECONDS)
        if what == "pause":
            people.setdefault(second, []).append(Paused())
            people.setdefault(second + rng.randrange(1, 20), []).append(Resumed())
        elif what == "gone":
            how = rng.choice(choices(Departure))
            people.setdefault(second, []).append(RobotGone(robot=rng.choice(names), how=how))
        else:
            why = rng.choice(choices(StopCause))
            people.setdefault(second, []).append(Stopped(why=why))
    return people


def random_windows(rng: random.Random) -> tuple[list[dict[str, object]], list[tuple[int, int]]]:
    """Windows of the morning on which it all happens, 00:16:40 being its beginning; and the same in seconds."""
    windows, spans = [], []
    for _ in range(rng.choice([0, 0, 1, 2])):
        minute, duration_s = rng.choice([14, 15, 16, 17, 18]), rng.randrange(60, 200)
        windows.append({"startTime": f"00:{minute}", "durationInSeconds": duration_s})
        spans.append((60 * minute, 60 * minute + duration_s))
    return windows, spans


def compare(seed: int) -> dict[str, object]:
    """One random fleet; its last facts."""
    rng = random.Random(seed)
    names = [f"r{number}" for number in range(rng.choice([1, 2, 3, 5, 8, 12]))]
    at_once, threshold = rng.choice([1, 20, 34, 50, 100]), rng.choice([1, 20, 50, 80, 100])
    canaries = rng.sample(names, rng.choice([0, 0, min(2, len(names))]))
    unfit = {name for name in names if rng.random() < 0.05}
    quality = rng.choice([0.0, 0.5, 0.8, 0.9])
    scripts = {name: random_script(rng, quality) for name in names}
    people = random_people(rng, names)
    repeats = rng.choice([None, seed])
    outage = (20, 20 + rng.randrange(1, 30)) if rng.random() < 0.2 else None
    windows, spans = random_windows(rng)
    requires_approval = rng.random() < 0.3
    plan = plan_of(
        names,
        unfit=unfit,
        windows=windows,
        requires_approval=requires_approval,
        concurrent_percentage=at_once,
        threshold_percentage=threshold,
        robot_timeout_s=ROBOT_TIMEOUT_S,
        job_timeout_s=JOB_TIMEOUT_S,
        canaries=tuple(canaries),
    )
    product = LedgerService(plan, 1000, stored_every=rng.choice([None, 1, 5]))
    model = RolloutModel(
        names,
        1000,
        at_once_percent=at_once,
        threshold_percent=threshold,
        robot_timeout_s=ROBOT_TIMEOUT_S,
        job_timeout_s=JOB_TIMEOUT_S,
        canaries=canaries,
        unfit=unfit,
        needs_yes=requires_approval,
        opening_hours=spans,
    )
    seen = watch(product, scripts, SECONDS, people, repeats, outage)
    expected = watch(model, scripts, SECONDS, people, repeats, outage)
    for second, (ours, theirs) in enumerate(zip(seen, expected, strict=True)):
        assert ours == theirs, f"seed {seed}, second {second}"
    assert product.most_open <= plan.concurrency
    return seen[-1]


@examples(100)
@given(st.integers(0, 2**32))
def test_product_and_model_agree_in_every_second(seed: int) -> None:
    compare(seed)


def test_random_fleets_meet_every_way_to_end() -> None:
    """That the comparison above says something: its fleets end in every way, and with every code."""
    ends = [compare(seed) for seed in range(170)]

    assert {(end["status"], end["code"]) for end in ends} >= {
        ("Succeeded", None),
        ("Canceled", None),
        ("Failed", "FailureThresholdBreached"),
        ("Failed", "FleetDeploymentTimeout"),
        ("Failed", "RobotApplicationDoesNotExist"),
        ("Failed", "DeploymentFleetDoesNotExist"),
    }
    codes = {code for end in ends for *_, code in end["robots"].values()}  # type: ignore[attr-defined]
    assert codes >= {"RobotDeploymentNoResponse", "RobotAgentConnectionTimeout", "RobotDeploymentAborted", *CODES}


@pytest.mark.parametrize(
    "most", [pytest.param(700, marks=pytest.mark.deep), pytest.param(8000, marks=pytest.mark.endurance)]
)
@pytest.mark.timeout(900)
def test_many_random_fleets(most: int) -> None:
    for seed in range(1000, 1000 + most):
        compare(seed)
