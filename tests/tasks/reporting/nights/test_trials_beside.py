"""Trials of two jobs side by side: which are offered, and what is said of each."""

from typing import Any

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.tasks.reporting.nights.trials_beside import trials_beside

LISTED = 100
"""Most failing trials that a job's summary lists."""


def result(failing: list[int], recorded: list[int], passed: int, **more: Any) -> RunResult:
    listed = [{"trial": number, "seed": 1, "verdict": "FAIL", "reason": "slow"} for number in failing[:LISTED]]
    counts = {"passed": passed, "failed": len(failing)}
    summary = {"planned": 500, "counts": counts, "failing": listed, "recorded": recorded, **more}
    times = {"sim_time_s": 1.0, "wall_time_s": 1.0, "real_time_factor": 1.0}
    empty: dict[str, Any] = {"requirements": [], "metrics": {}, "versions": {}, "summary": ""}
    more_of_it = {"trials": summary}
    return RunResult(verdict="FAIL", ended_by="environment", seed=1, extra=more_of_it, **times, **empty)


def test_the_first_trial_that_differs_is_shown() -> None:
    found = trials_beside((result([3], [0, 3], 499), result([3, 7], [0, 3, 7], 498)))
    assert found is not None
    assert (found.first, found.differing) == (7, {7})
    assert found.told[7] == ("passed", "failed, slow")


def test_a_trial_beyond_those_that_are_listed_is_not_said_to_have_passed() -> None:
    """It may be one of the failures that the summary has no place for."""
    found = trials_beside((result([400], [400], 499), result(list(range(450)), [0], 50)))
    assert found is not None
    assert found.told[400] == ("failed, slow", "not known")
    assert 400 not in found.differing


def test_what_was_not_run_and_what_left_nothing_are_said() -> None:
    found = trials_beside((result([3], [3], 2, stopped_in=2), None))
    assert found is not None
    assert found.told[3] == ("failed, slow", "left no result of its trials")
    stopped = trials_beside((result([3], [3], 499), result([0], [0], 1, stopped_in=2)))
    assert stopped is not None
    assert stopped.told[3] == ("failed, slow", "was not run")
    assert 3 not in stopped.differing
