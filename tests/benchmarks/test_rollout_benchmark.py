"""What it costs to plan a rollout to 10,000 robots and to fold all that they report."""

import heapq
import json
import random
import time
from collections import Counter
from itertools import count

import pytest
from helpers.rollout_ledger import advance, plan_of

from prefect_robomaker.schemas.fleet.operations.deployment_jobs import RobotDeploymentStep
from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    Failed,
    Fetched,
    Offered,
    Progressed,
    Report,
    Rollout,
    Succeeded,
)
from prefect_robomaker.tasks.fleet.rollout.ledger import Ledger, begin

ROBOTS = 10_000
STEPS: tuple[tuple[RobotDeploymentStep, float | None], ...] = (
    ("DownloadingExtracting", 0),
    ("DownloadingExtracting", 30),
    ("DownloadingExtracting", 60),
    ("DownloadingExtracting", 100),
    ("ExecutingDownloadCondition", None),
    ("ExecutingPreLaunch", None),
    ("Launching", None),
)


def life(robot: str, number: int, now_s: float, rng: random.Random) -> list[tuple[float, Report]]:
    """What a robot reports of an order: a fiftieth never fetches it, a fiftieth falls silent, a twentieth fails."""
    chance = rng.random()
    if chance < 0.02:
        return []
    said: list[Report] = [Fetched(robot=robot, action_id=number)]
    said += [Progressed(robot=robot, action_id=number, step=step, percent_done=done) for step, done in STEPS]
    if chance < 0.04:
        said = said[: rng.randrange(1, len(said))]
    elif chance < 0.09:
        said.append(Failed(robot=robot, action_id=number, code="PostLaunchFileFailure"))
    else:
        said.append(Succeeded(robot=robot, action_id=number))
    times = sorted(now_s + rng.uniform(1, 900) for _ in said)
    return list(zip(times, said, strict=True))


@pytest.mark.benchmark
def test_ten_thousand_robots_planned_and_folded() -> None:
    rng, numbers, ties = random.Random(7), count(1), count()
    started = time.perf_counter()
    ledger = Ledger(begin(plan_of([f"arn:{n}" for n in range(ROBOTS)]), 0))
    planned_s = time.perf_counter() - started
    reports: list[tuple[float, int, Report]] = []
    now_s, events, wakes, fold_s = 0.0, 0, 0, 0.0
    while True:
        started = time.perf_counter()
        ledger.pass_time(now_s)
        offers, wake_s = ledger.offers(), ledger.wake_s()
        orders = [Offered(robot=robot, action_id=next(numbers)) for robot in offers]
        for order in orders:
            ledger.apply(order, now_s)
        fold_s += time.perf_counter() - started
        events += len(orders)
        for order in orders:
            for when_s, report in life(order.robot, order.action_id, now_s, rng):
                heapq.heappush(reports, (when_s, next(ties), report))
        if not reports and wake_s is None and not orders:
            break
        now_s = min([report[0] for report in reports[:1]] + ([wake_s] if wake_s is not None else [now_s]))
        started = time.perf_counter()
        until_s = now_s + 1
        while reports and reports[0][0] <= until_s:  # what came within a second
            now_s, _, report = heapq.heappop(reports)
            ledger.apply(report, now_s)
            events += 1
        fold_s += time.perf_counter() - started
        wakes += 1

    started = time.perf_counter()
    stored = json.dumps(ledger.rollout().to_json())
    write_s = time.perf_counter() - started
    started = time.perf_counter()
    rollout = Rollout.of_json(json.loads(stored))
    read_s = time.perf_counter() - started
    started = time.perf_counter()
    advance(rollout, Fetched(robot="arn:1", action_id=1), now_s)
    single_s = time.perf_counter() - started

    assert rollout == ledger.rollout()
    assert all(state.has_ended for state in rollout.robots.values())
    print(
        f"\n{ROBOTS} robots, {events} events, asked {wakes} times: planned in {planned_s:.2f} s, "
        f"folded in {fold_s:.2f} s ({1e6 * fold_s / events:.0f} microseconds an event); "
        f"stored {len(stored) / 1e6:.1f} MB, written in {write_s:.2f} s, read in {read_s:.2f} s; "
        f"one event without a ledger {1e3 * single_s:.0f} ms; "
        f"{Counter(state.failure_code for state in rollout.robots.values())}"
    )
