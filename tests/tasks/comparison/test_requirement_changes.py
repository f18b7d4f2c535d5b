"""Changes of requirements name the code that changed; chance is named only where nothing did."""

from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_job, make_night, store_night, trials_of

from prefect_robomaker.deployments.cli.output.comparison import comparison_lines
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.comparison.better_or_worse import compare
from prefect_robomaker.tasks.comparison.compared_runs import NightRun, reason_of
from prefect_robomaker.tasks.comparison.history import since_last_run
from prefect_robomaker.tasks.reporting.nights.changes import place_in_words, requirement_in_words
from prefect_robomaker.tasks.results.table import RESULTS_FILE, ResultTable


def test_a_trial_is_named_by_the_values_of_its_axes(tmp_path: Path) -> None:
    """The trial with a mass of 2.1 newly misses; the axis of the step is in the name of the job."""
    runs = []
    for night, letters in enumerate(("PP", "PF")):
        job = make_job(0, letters[1], night=night).model_copy(update={"axes": {"robot": "scout"}})
        table = trials_of(letters, axes={"mass": "2.1", "floor": "a rug that is quite long and green"})
        record = make_night([job], night, runs=tmp_path)
        ResultTable.of([job], lambda _, table=table: table).write(store_night(record) / RESULTS_FILE)
        runs.append(NightRun.of(record))
    comparison = compare(*runs)
    [change] = comparison.requirements
    [place] = change.places
    title = "mass 2.1, floor a rug that is quite lon… (trial 1)"
    assert place_in_words(place) == f"drive: world-1 scout, seed 7, {title}: 9 N, at most 5 N asked"
    assert (place.before_job, place.before_trial) == ("sim-0-0", 1)
    lines = comparison_lines(comparison)
    assert "  watch one     robomaker repro sim-1-0 --trial 1" in lines
    assert "  the same in A robomaker repro sim-0-0 --trial 1" in lines


def test_an_axis_that_shares_no_value_is_why_runs_are_not_comparable(tmp_path: Path) -> None:
    runs = []
    for night, bias in enumerate(("0", "0.12")):
        job = make_job(0, "P", night=night)
        table = trials_of("PP", axes={"bias": bias, "floor": "rug"})
        record = make_night([job], night, runs=tmp_path)
        ResultTable.of([job], lambda _, table=table: table).write(store_night(record) / RESULTS_FILE)
        runs.append(NightRun.of(record))
    comparison = compare(*runs)
    assert comparison.why.startswith(
        "no trials are pairs: axis bias is 0 in the first run and 0.12 in the second run. Trials are compared where "
    )
    assert "  pairs         both runs have 1 job, and no trial in common" in comparison_lines(comparison)


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


@pytest.mark.parametrize(("known", "told"), [(True, []), (False, ["no hard collision"])])
def test_a_health_requirement_that_did_not_count_before_is_not_newly_missed(known: bool, told: list[str]) -> None:
    """It does not count in a run that ended with its goals reached, so that nothing can be compared."""
    hit = Requirement(name="no hard collision", kind="health", satisfied=False, detail="247 N")
    jobs = [make_job(0, "P"), make_job(0, "F", night=1)]
    own = [[hit.model_copy(update={"satisfied": True, "counts": False})] if known else [], [hit]]
    asked = [each for each in jobs[0].requirements if each.satisfied]
    nights = [
        make_night([job.model_copy(update={"requirements": [*asked, *more]})], night)
        for night, (job, more) in enumerate(zip(jobs, own, strict=True))
    ]
    assert [each.name for each in compare(*map(NightRun.of, nights)).requirements] == told
