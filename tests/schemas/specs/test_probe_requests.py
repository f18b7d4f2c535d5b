"""Requests of probes: smaller, valid, and with the seeds of the whole ones."""

import json
from typing import Any

import pytest
from helpers.small_flat import ROLE
from helpers.variable_axes import trials_of_variables
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.operations.registry import parse_request
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.probe_requests import (
    BATCH,
    GENERATION,
    JOB,
    JobAmount,
    ProbeSize,
    check_probed,
    cut,
    cut_trials,
    jobs_in,
    kind_of,
    of_each_kind,
    spread,
    worlds_in,
)
from prefect_robomaker.schemas.wire.errors import SpecError

SIZE = ProbeSize(worlds=6, jobs=2, trials=4)
COUNTS = st.integers(min_value=1, max_value=50)


def order(**members: Any) -> dict[str, Any]:
    applications = [{"application": "indoor-navigation", "launchConfig": {}}]
    return {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "simulationApplications": applications, **members}


@given(COUNTS, COUNTS, st.integers(min_value=1, max_value=200))
def test_worlds_are_fewer_and_no_more_than_asked_for(floorplans: int, interiors: int, most: int) -> None:
    request = {"worldCount": {"floorplanCount": floorplans, "interiorCountPerFloorplan": interiors}, "seed": 7}
    probed = cut(GENERATION, request, ProbeSize(most, 1, 1))
    assert 1 <= worlds_in(probed) <= min(most, worlds_in(request))
    assert probed["seed"] == 7
    if worlds_in(request) <= most:
        assert probed == request


@given(st.lists(st.integers()), st.integers(min_value=1, max_value=20))
def test_chosen_items_are_in_order_and_begin_with_the_first(items: list[int], most: int) -> None:
    numbered = list(enumerate(items))
    chosen = spread(numbered, most)
    assert len(chosen) == min(most, len(items))
    assert chosen == sorted(chosen)
    assert len(set(chosen)) == len(chosen)
    assert chosen[:1] == numbered[:1]


@given(st.integers(1, 100), st.lists(st.integers(1, 5), max_size=3), st.integers(1, 100), st.integers(0, 20))
def test_trials_are_fewer_and_still_trials(seeds: int, sizes: list[int], most: int, record_failed: int) -> None:
    values = {f"P{i}": [str(value) for value in range(size)] for i, size in enumerate(sizes)}
    trials = trials_of_variables(seeds, values, record=[0], record_failed=record_failed)
    probed = cut_trials(trials, most)
    assert 1 <= probed.count <= min(trials.count, max(1, most))
    assert probed.record == [0]
    assert probed.record_failed <= trials.record_failed


@given(st.lists(st.sampled_from("abcde"), min_size=1), st.integers(min_value=1, max_value=20))
def test_one_of_each_kind_is_chosen_before_a_second(kinds: list[str], most: int) -> None:
    chosen = of_each_kind(kinds, most)
    assert len(chosen) == min(most, len(kinds))
    assert chosen == sorted(set(chosen))
    assert len({kinds[index] for index in chosen}) == min(len(set(kinds)), most)


def test_jobs_of_one_kind_differ_in_seed_world_trials_and_tags() -> None:
    world = {"worldConfigs": [{"world": "arn:aws:robomaker:us-east-1:000000000000:world/world-1"}]}
    launch = {"environmentVariables": {"ROBOMAKER_TRIALS": '{"seeds": 3}'}}
    alike = [
        order(seed=3, tags={"night": "7"}, trials={"seeds": 9}),
        order(simulationApplications=[{"application": "indoor-navigation", "launchConfig": {}, **world}]),
        order(simulationApplications=[{"application": "indoor-navigation", "launchConfig": launch}]),
    ]
    others = [
        order(maxJobDurationInSeconds=61),
        order(simulationApplications=[{"application": "other", "launchConfig": {}}]),
        order(
            simulationApplications=[
                {"application": "indoor-navigation", "launchConfig": {"environmentVariables": {"OBSTACLES": "9"}}}
            ]
        ),
    ]
    assert len({kind_of(job) for job in [order(), *alike]}) == 1
    assert len({kind_of(job) for job in [order(), *others]}) == 4


def test_a_batch_keeps_jobs_from_all_over_it() -> None:
    requests = [order(seed=seed) for seed in range(10)]
    request = {"createSimulationJobRequests": requests, "clientRequestToken": "night-7", "batchPolicy": {}}
    probed = cut(BATCH, request, SIZE)
    assert [job["seed"] for job in probed["createSimulationJobRequests"]] == [0, 5]
    assert "clientRequestToken" not in probed  # the whole request is to use it
    assert probed["batchPolicy"] == {}


@pytest.mark.parametrize("as_variable", [False, True])
def test_trials_of_a_job_are_cut_wherever_they_are_given(as_variable: bool) -> None:
    trials = {"seeds": 100, "axes": {"SPEED": {"kind": "variable", "values": ["1", "2"]}}, "record": [150]}
    variables = {"ROBOMAKER_TRIALS": json.dumps(trials), "OTHER": "1"}
    launch = {"environmentVariables": variables if as_variable else {"OTHER": "1"}}
    applications = [{"application": "indoor-navigation", "launchConfig": launch}]
    request = order(simulationApplications=applications, **({} if as_variable else {"trials": trials}))
    assert jobs_in(JOB, request) == [JobAmount(trials=200, limit_s=60.0, kind=kind_of(request))]

    probed = cut(JOB, request, SIZE)

    parse_request(JOB, probed)
    assert jobs_in(JOB, probed) == [JobAmount(trials=4, limit_s=60.0, kind=kind_of(request))]
    assert probed["trials"]["axes"] == trials["axes"]
    assert probed["trials"]["record"] == [0]
    assert probed["simulationApplications"][0]["launchConfig"]["environmentVariables"] == {"OTHER": "1"}


def test_other_requests_stay_as_they_are() -> None:
    assert cut("CreateWorldTemplate", {"name": "flat"}, SIZE) == {"name": "flat"}
    assert jobs_in("CreateWorldTemplate", {"name": "flat"}) == []


def test_a_step_that_changes_what_is_there_is_refused_with_its_place() -> None:
    text = """\
version: 1
name: nightly
steps:
  jobs: {operation: ListSimulationJobs}
  stop:
    operation: CancelSimulationJob
    input: {job: "${{ jobs.simulationJobSummaries[0].arn }}"}
"""
    with pytest.raises(SpecError, match=r"nightly.yaml:7:.*steps.stop.input: CancelSimulationJob changes what is"):
        check_probed(load_spec(text, "nightly.yaml"))
