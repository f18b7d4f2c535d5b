"""Changes of requirements name the code that changed; chance is named only where nothing did."""

from typing import Any

import pytest
from helpers.night_records import make_job, make_night

from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.comparison.better_or_worse import compare
from prefect_robomaker.tasks.comparison.compared_runs import NightRun, reason_of
from prefect_robomaker.tasks.comparison.history import since_last_run
from prefect_robomaker.tasks.reporting.nights.changes import requirement_in_words


@pytest.mark.parametrize(
    ("changed", "end"),
    [
        ({}, "the same; `robomaker flaky` tells whether it is chance"),
        ({"robot": "robot 2"}, "the same, but application scout differs"),
        ({"request": "other"}, "the same, but the request differs"),
        ({"robot": "robot 2", "request": "other"}, "the same, but application scout and the request differ"),
    ],
)
def test_a_newly_missed_requirement_names_what_is_not_the_same(changed: dict[str, Any], end: str) -> None:
    before, after = make_night([make_job(0, "P")]), make_night([make_job(0, "F", night=1, **changed)], 1)
    comparison = compare(NightRun.of(before), NightRun.of(after))
    [change] = comparison.requirements
    words = requirement_in_words(change)
    assert words == f"gentle: newly missed in 1 of 1 trial; world and seed are {end}"
    assert {each.what for each in comparison.changed} == {{"robot": "application"}.get(kind, kind) for kind in changed}


def test_another_version_of_a_package_is_named_before_chance() -> None:
    """The physics may be others then, which reruns with the new version alone cannot tell."""
    before, after = make_night([make_job(0, "P")]), make_night([make_job(0, "F", night=1)], 1)
    after = after.model_copy(update={"versions": {**after.versions, "mujoco": "3.18.0"}})
    before = before.model_copy(update={"versions": {**before.versions, "mujoco": "3.17.0"}})
    [compared] = compare(NightRun.of(before), NightRun.of(after)).requirements
    [told] = since_last_run([NightRun.of(before), NightRun.of(after)]).requirements
    for change in (compared, told):
        assert requirement_in_words(change).endswith("world and seed are the same, but mujoco differs")


def test_of_trials_the_command_is_named_that_repeats_trials() -> None:
    """Jobs with trials are not run again by `flaky`."""
    before, after = make_night([make_job(0, "P")]), make_night([make_job(0, "F", night=1)], 1)
    [change] = compare(NightRun.of(before), NightRun.of(after)).requirements
    of_trial = [change.places[0].model_copy(update={"trial": 3})]
    words = requirement_in_words(change.model_copy(update={"places": of_trial}))
    assert words.endswith("world and seed are the same; `robomaker verify` tells whether it is chance")


def test_the_reason_of_a_job_with_trials_says_trials_once() -> None:
    own = Requirement(name="trials", satisfied=False, detail="1 of 2 trials did not pass: trial 0")
    job = make_job(0, "F").model_copy(update={"requirements": [own]})
    assert reason_of(job) == "1 of 2 trials did not pass: trial 0"
