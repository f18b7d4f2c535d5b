"""A fleet of thousands of simulated robots that lose power, fall silent, fail and return, drawn from a seed."""

import random

from helpers.rollout_ledger import plan_of
from helpers.rollout_model import RolloutModel
from helpers.rollout_robots import CODES, Attempt, Script
from prefect_robomaker.schemas.fleet.operations.deployment_jobs import RobotDeploymentStep
from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import RolloutPlan

ROBOT_TIMEOUT_S = 40
LONGEST_S = 900
"""After so long, each rollout of such a fleet has ended, and robots that were away are back."""

STEPS: tuple[tuple[int, RobotDeploymentStep, float | None], ...] = (
    (1, "DownloadingExtracting", 0.0),
    (2, "DownloadingExtracting", 40.0),
    (3, "DownloadingExtracting", 90.0),
    (4, "ExecutingDownloadCondition", None),
    (5, "ExecutingPreLaunch", None),
    (6, "Launching", None),
    (7, "ExecutingPostLaunch", None),
)


def draw_scripts(robots: int, seed: int, failing: float = 0.05) -> dict[str, Script]:
    """What each robot does: most of ten reports an order, some without power, silent or failing."""
    rng = random.Random(seed)
    return {f"r{number}": _script(rng, failing) for number in range(robots)}


def _script(rng: random.Random, failing: float) -> Script:
    silent, fails = rng.random() < failing / 2, rng.random() < failing
    attempt = Attempt(
        fetch_s=rng.randrange(1, 6),
        end=None if silent else rng.choice(CODES) if fails else "success",
        end_s=rng.randrange(8, 20),
        reports=STEPS,
        cancel=rng.choice(["give up", "give up", "give up", "refuse"]),
        cancel_s=rng.randrange(1, 5),
    )
    cuts = sorted(rng.sample(range(LONGEST_S - 200), rng.choice([0, 1, 1, 2, 10])))
    off = [(begin, begin + rng.randrange(1, 12)) for begin in cuts]
    if rng.random() < failing:  # away for the whole rollout, nearly
        off.append((0, rng.randrange(50, LONGEST_S - 200)))
    return Script((attempt,), tuple(off))


def plan_for(scripts: dict[str, Script], threshold: int = 60, canaries: int = 10) -> RolloutPlan:
    """A rollout in five rounds."""
    return plan_of(
        list(scripts),
        concurrent_percentage=20,
        threshold_percentage=threshold,
        robot_timeout_s=ROBOT_TIMEOUT_S,
        canaries=tuple(list(scripts)[:canaries]),
    )


def model_for(scripts: dict[str, Script], now_s: int, threshold: int = 60, canaries: int = 10) -> RolloutModel:
    """The same rollout by brute force."""
    return RolloutModel(
        list(scripts),
        now_s,
        at_once_percent=20,
        threshold_percent=threshold,
        robot_timeout_s=ROBOT_TIMEOUT_S,
        job_timeout_s=30 * 24 * 3600,
        canaries=list(scripts)[:canaries],
    )
