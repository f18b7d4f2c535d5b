"""Trials of two jobs side by side: which are offered, and what is said of each."""

from collections.abc import Mapping
from typing import Any

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.reporting.nights.trials_beside import SideTrials, TrialsBeside, trials_beside

LISTED = 100
"""Most failing trials that a job's summary lists."""


def result(failing: list[int], recorded: list[int], passed: int, **more: Any) -> RunResult:
    listed = [{"trial": number, "seed": 1, "verdict": "FAIL", "reason": "slow"} for number in failing[:LISTED]]
    counts = {"passed": passed, "failed": len(failing)}
    summary = {"planned": 500, "counts": counts, "failing": listed, "recorded": recorded} | more
    times = {"sim_time_s": 1.0, "wall_time_s": 1.0, "real_time_factor": 1.0}
    empty: dict[str, Any] = {"requirements": [], "metrics": {}, "versions": {}, "summary": ""}
    more_of_it = {"trials": summary}
    return RunResult(verdict="FAIL", ended_by="environment", seed=1, extra=more_of_it, **times, **empty)


def beside(*results: RunResult | None, orders: Mapping[int, Trials] | None = None) -> TrialsBeside | None:
    """Trials of two results, whose requests may order trials, by their place."""
    before, after = (
        SideTrials(each, (orders or {}).get(place), 5 if orders else None) for place, each in enumerate(results)
    )
    return trials_beside((before, after))


def ordered(*values: float) -> Trials:
    """Two trials for each of some masses, with the seeds 5 and 6."""
    return Trials.model_validate({"seeds": 2, "axes": {"mass": {"kind": "robot_mass", "values": list(values)}}})


def test_trials_are_the_same_by_seed_and_values_and_not_by_number() -> None:
    """Without the mass of 1, the trial that has number 3 in the first job is number 1 in the second."""
    orders = {0: ordered(1.0, 1.2), 1: ordered(1.2)}
    found = beside(result([], [0, 3], 4, planned=4), result([1], [1], 1, planned=2), orders=orders)
    assert found is not None
    assert (found.numbers, found.before, found.told[1]) == ((1,), {1: 3}, ("passed", "failed, slow"))
    assert found.titles == {1: "mass 1.2 (trial 1)"}
    gone = beside(result([], [], 2, planned=2), result([1], [1], 1, planned=2), orders={0: ordered(1.0), 1: ordered(2)})
    assert gone is not None
    assert (gone.before, gone.told[1], gone.differing) == ({1: None}, ("has no such trial", "failed, slow"), set())


def test_a_trial_without_axes_is_not_named_by_those_of_the_other_job() -> None:
    """The second job has no axes any more: the value of the first job's trial with that number is not its own."""
    found = beside(
        result([], [0, 1], 4, planned=4),
        result([1], [0, 1], 1, planned=2),
        orders={0: ordered(1.0, 1.2), 1: Trials(seeds=2)},
    )
    assert found is not None
    assert found.titles == {0: "trial 0", 1: "trial 1"}


def test_the_first_trial_that_differs_is_shown() -> None:
    found = beside(result([3], [0, 3], 499), result([3, 7], [0, 3, 7], 498))
    assert found is not None
    assert (found.first, found.differing) == (7, {7})
    assert found.told[7] == ("passed", "failed, slow")


def test_a_trial_beyond_those_that_are_listed_is_not_said_to_have_passed() -> None:
    """It may be one of the failures that the summary has no place for."""
    found = beside(result([400], [400], 499), result(list(range(450)), [0], 50))
    assert found is not None
    assert found.told[400] == ("failed, slow", "not known")
    assert 400 not in found.differing


def test_what_was_not_run_and_what_left_nothing_are_said() -> None:
    found = beside(result([3], [3], 2, stopped_in=2), None)
    assert found is not None
    assert found.told[3] == ("failed, slow", "left no result of its trials")
    stopped = beside(result([3], [3], 499), result([0], [0], 1, stopped_in=2))
    assert stopped is not None
    assert stopped.told[3] == ("failed, slow", "was not run")
    assert 3 not in stopped.differing
