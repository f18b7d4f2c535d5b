"""Rollouts of robots that carry out their orders in simulated time, and what a report of each is made from."""

import heapq
import itertools
import random
from collections.abc import Callable

from prefect_robomaker.schemas.fleet.operations.deployment_jobs import (
    DeploymentConfig,
    DeploymentLaunchConfig,
    MaintenanceWindow,
    RobotDeploymentStep,
)
from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    DeploymentReport,
    Failed,
    Fetched,
    Offered,
    Progressed,
    Rollout,
    RolloutEvent,
    Succeeded,
)
from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import Artifact, Delivery, PlannedRobot, RolloutPlan
from prefect_robomaker.tasks.fleet.rollout.ledger import Ledger, begin
from prefect_robomaker.tasks.fleet.rollout.waves import waves_of

BEGAN_S = 1_800_000_000.0
_STEPS: tuple[RobotDeploymentStep, ...] = (
    "Validating",
    "DownloadingExtracting",
    "ExecutingPreLaunch",
    "Launching",
    "ExecutingPostLaunch",
)


def arn_of(name: str) -> str:
    return f"arn:aws:robomaker:us-east-1:123456789012:robot/{name}/1"


def simulate(
    names: list[str],
    *,
    concurrent: int = 20,
    threshold: int = 20,
    bad: Callable[[int], bool] = lambda _: False,
    silent: Callable[[int], bool] = lambda _: False,
    until_s: float = 1e9,
    events: tuple[tuple[float, RolloutEvent], ...] = (),
    seed: int = 7,
    windows: tuple[MaintenanceWindow, ...] = (),
) -> Rollout:
    """Rolls out to robots until nothing goes on any more, or for some seconds.

    Args:
        names: Names of the robots.
        concurrent: At the same time, in percent.
        threshold: Of failures, in percent.
        bad: Which robots fail, by number.
        silent: Which robots never fetch their orders.
        until_s: When to stop, in seconds since it began.
        events: What else happens, and when.
        seed: Of how long robots take.
        windows: When robots may be changed; none: always.
    """
    rng, numbers, ties = random.Random(seed), itertools.count(1), itertools.count()
    robots = tuple(
        PlannedRobot(arn=arn_of(name), installed=None if number % 5 == 4 else "courier 1")
        for number, name in enumerate(names)
    )
    plan = RolloutPlan(
        robots=robots,
        concurrent_percentage=concurrent,
        threshold_percentage=threshold,
        robot_timeout_s=120,
        windows=windows,
    )
    place = {robot.arn: number for number, robot in enumerate(robots)}
    ledger = Ledger(begin(plan, BEGAN_S))
    coming: list[tuple[float, int, RolloutEvent]] = [(BEGAN_S + at_s, next(ties), event) for at_s, event in events]
    heapq.heapify(coming)
    now_s = BEGAN_S
    while now_s <= BEGAN_S + until_s:
        ledger.pass_time(now_s)
        offers, wake_s = ledger.offers(), ledger.wake_s()
        for robot in offers:
            number = next(numbers)
            ledger.apply(Offered(robot=robot, action_id=number), now_s)
            if not silent(place[robot]):
                for at_s, event in _life(robot, number, now_s, rng, bad=bad(place[robot])):
                    heapq.heappush(coming, (at_s, next(ties), event))
        following = [coming[0][0]] if coming else []
        following += [wake_s] if wake_s is not None and ledger.status == "InProgress" else []
        if not offers and not following:
            break
        now_s = min(following, default=now_s)
        while coming and coming[0][0] <= now_s and now_s <= BEGAN_S + until_s:
            ledger.apply(heapq.heappop(coming)[2], now_s)
    return ledger.rollout()


def _life(robot: str, number: int, now_s: float, rng: random.Random, *, bad: bool) -> list[tuple[float, RolloutEvent]]:
    at_s = now_s + rng.uniform(0.5, 6)
    life: list[tuple[float, RolloutEvent]] = [(at_s, Fetched(robot=robot, action_id=number))]
    for step, longest_s in zip(_STEPS, (2, 30, 5, 4, 8), strict=True):
        life.append((at_s, Progressed(robot=robot, action_id=number, step=step)))
        at_s += rng.uniform(0.3, 1) * longest_s
    if bad:
        reason = "postLaunchFile: exit code 1: Der Arm antwortet nicht — ロボットアームが応答しません"
        life.append((at_s, Failed(robot=robot, action_id=number, code="PostLaunchFileFailure", reason=reason)))
    else:
        life.append((at_s, Succeeded(robot=robot, action_id=number)))
    return life


def report_of(rollout: Rollout, fleet: str = "yard", now_s: float = 0.0) -> DeploymentReport:
    """What the report of a rollout is made from."""
    launch = DeploymentLaunchConfig(
        packageName="courier",
        launchFile="drive.launch",
        postLaunchFile="health.sh",
        environmentVariables={"GREETING": "Grüß Gott <b>", "X_TOKEN": "hunter2"},
    )
    file = Artifact(
        bucket="apps", key="k", file_name="application.swu", size_bytes=10_240_000,
        sha256="ab12" * 16, sha1="cd34" * 10, md5="ef56" * 8, name="courier", version="2",
    )  # fmt: skip
    return DeploymentReport(
        job="arn:aws:robomaker:us-east-1:123456789012:deployment-job/deployment-ab12cd34",
        fleet=fleet,
        application="courier",
        version="2",
        status=rollout.status,
        failure_code=rollout.failure_code,
        failure_reason=rollout.failure_reason,
        created_s=rollout.began_s - 3,
        now_s=max(now_s, rollout.now_s),
        config=DeploymentConfig(
            concurrentDeploymentPercentage=rollout.plan.concurrent_percentage,
            failureThresholdPercentage=rollout.plan.threshold_percentage,
            robotDeploymentTimeoutInSeconds=120,
        ),
        delivery=Delivery(
            artifacts={"X86_64": file},
            architectures=dict.fromkeys(rollout.plan.order, "X86_64"),
            launch=launch,
        ),
        rollout=rollout,
        waves=tuple(waves_of(rollout.plan)),
    )
