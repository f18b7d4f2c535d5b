"""The plan of trials: which there are, with which seeds and parameters."""

import itertools
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.operations.registry import parse_request
from prefect_robomaker.schemas.operations.simulation_jobs import SimulationJobRequestMembers
from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.trial_rows import plan_of_trial
from prefect_robomaker.schemas.runs.trials import TRIALS_VARIABLE, Trial, Trials, planned_trials, trials_of
from prefect_robomaker.schemas.wire.common import MAX_SEED
from prefect_robomaker.schemas.wire.errors import InvalidParameterException

NAMES = st.text("ABC_", min_size=1, max_size=3)
VALUES = st.lists(st.text("xyz01.", min_size=1, max_size=3), min_size=1, max_size=4, unique=True)
SOME_TRIALS = st.builds(
    Trials,
    seeds=st.integers(1, 20),
    parameters=st.none() | st.dictionaries(NAMES, VALUES, max_size=4),
)


@given(SOME_TRIALS, st.integers(0, MAX_SEED))
def test_there_is_one_trial_of_each_seed_and_combination(trials: Trials, seed: int) -> None:
    all_trials = [trials.trial(number, seed) for number in range(trials.count)]

    parameters = trials.parameters or {}
    seeds = [(seed + offset) % (MAX_SEED + 1) for offset in range(trials.seeds)]
    expected = [
        Trial(number, each, dict(zip(parameters, values, strict=True)))
        for number, (values, each) in enumerate(
            (values, each) for values in itertools.product(*parameters.values()) for each in seeds
        )
    ]
    assert all_trials == expected
    assert all(list(each.parameters) == list(parameters) for each in all_trials)
    for outside in (-1, trials.count):
        with pytest.raises(IndexError, match="there is no trial"):
            trials.trial(outside, seed)


@given(SOME_TRIALS)
def test_trials_are_the_same_after_a_way_through_json(trials: Trials) -> None:
    assert Trials.model_validate(json.loads(json.dumps(trials.to_wire()))) == trials


@given(SOME_TRIALS, st.data())
def test_the_plan_of_a_trial_is_that_of_a_job_with_its_seed_and_variables(trials: Trials, data: Any) -> None:
    arena = ApplicationPlan(
        role="simulation", name="arena", attribute="a.b", environment_variables={"A": "old", "Z": "1"}
    )
    members = {
        "job_id": "sim-1",
        "job_arn": "",
        "run_id": "r",
        "max_duration_s": 1.0,
        "work_dir": "/w",
        "output_dir": "/o",
    }
    plan = RunPlan.model_validate(
        {**members, "seed": 7, "trials": trials, "simulation_application": arena, "environment": {"A": "older"}},
        strict=False,
    )
    trial = trials.trial(data.draw(st.integers(0, trials.count - 1)), 7)

    alone = plan_of_trial(plan, trial)

    assert (alone.seed, alone.trials, alone.trial) == (trial.seed, None, trial.number)
    assert alone.simulation_application is not None
    assert alone.simulation_application.environment_variables == {"A": "old", "Z": "1", **trial.parameters}
    assert alone.environment == {"A": "older", **trial.parameters}


def order(trials: dict[str, Any] | None = None, variable: str | None = None) -> SimulationJobRequestMembers:
    variables = {TRIALS_VARIABLE: variable} if variable else {}
    launch = {"environmentVariables": variables}
    request: dict[str, Any] = {
        "maxJobDurationInSeconds": 10,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "simulationApplications": [{"application": "arena", "launchConfig": launch}],
    }
    parsed = parse_request("CreateSimulationJob", request | ({"trials": trials} if trials else {}))
    assert isinstance(parsed, SimulationJobRequestMembers)
    return parsed


@given(SOME_TRIALS, st.booleans())
def test_a_request_is_seen_to_plan_as_many_trials_as_it_orders(trials: Trials, by_variable: bool) -> None:
    wire = trials.to_wire()
    made = order(variable=json.dumps(wire)) if by_variable else order(wire)

    assert planned_trials(made.to_wire()) == trials.count


ANYTHING = st.recursive(
    st.none() | st.integers() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["launchConfig", "environmentVariables", TRIALS_VARIABLE, "seeds", "x"]), inner, max_size=3
        )
    ),
)


@given(st.dictionaries(st.sampled_from(["trials", "simulationApplications", "robotApplications"]), ANYTHING))
def test_a_request_that_is_not_checked_yet_plans_some_number_of_trials_or_none(request: dict[str, Any]) -> None:
    assert planned_trials(request) >= 0


def test_a_launch_variable_says_the_same_as_the_member() -> None:
    trials = {"seeds": 3, "parameters": {"SPEED": ["0.2", "0.4"]}}
    assert trials_of(order(trials)) == trials_of(order(variable=json.dumps(trials))) == Trials(**trials)
    assert trials_of(order(trials, json.dumps(trials))) == Trials(**trials)
    assert trials_of(order()) is None


@pytest.mark.parametrize(
    ("trials", "said"),
    [
        ({"seeds": 0}, r"trials\.seeds: is 0; it has to be at least 1"),
        ({"seeds": 2, "record": [2]}, r"record: there is no trial 2; the trials are 0 to 1"),
        ({"seeds": 2, "parameters": {"speed": ["1"]}}, r"trials\.parameters\.speed: the key is 'speed'"),
        ({"seeds": 2, "parameters": {"SPEED": [0.2]}}, r"trials\.parameters\.SPEED\[0\]: is 0\.2; it has to be text"),
        ({"seeds": 2, "parameters": {"SPEED": ["1", "1"]}}, "values have to differ; '1' appears more than once"),
        ({"seeds": 2, "parameters": {"ROBOMAKER_SEED": ["1"]}}, "ROBOMAKER_SEED cannot differ from trial to trial"),
        ({"seeds": 10**6, "parameters": {"A": ["1", "2"]}}, "are 2000000 trials; a job has at most 1000000"),
        ({"seed": 2}, r"trials\.seed"),
    ],
)
def test_what_is_wrong_with_trials_is_said(trials: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidParameterException, match=said):
        order(trials)
    with pytest.raises(InvalidParameterException, match=said.removeprefix(r"trials")):
        order(variable=json.dumps(trials))


def test_member_and_variable_may_not_differ() -> None:
    with pytest.raises(InvalidParameterException, match=r"trials and simulationApplications.* differ"):
        order({"seeds": 2}, '{"seeds": 3}')


@pytest.mark.parametrize(
    "launch",
    [{"command": ["sleep", "1"]}, {"packageName": "nav", "launchFile": "drive.py"}, {"launchFile": "nav.launch.py"}],
)
def test_trials_of_what_is_launched_as_a_program_are_refused_before_anything_runs(launch: dict[str, Any]) -> None:
    request: dict[str, Any] = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "robotApplications": [{"application": "nav", "launchConfig": launch}],
    }
    with pytest.raises(InvalidParameterException, match=r"trials: robotApplications\[0\].*factories"):
        parse_request("CreateSimulationJob", {**request, "trials": {"seeds": 2}})

    assert parse_request("CreateSimulationJob", request)
