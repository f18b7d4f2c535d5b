"""The plan of trials: which there are, with which seeds and values of axes."""

import itertools
import json
import re
from typing import Any

import pytest
from helpers.paths import REPOSITORY
from helpers.variable_axes import variables
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from prefect_robomaker.schemas.operations.registry import parse_request
from prefect_robomaker.schemas.operations.simulation_jobs import SimulationJobRequestMembers
from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.trial_rows import plan_of_trial
from prefect_robomaker.schemas.runs.trials import TRIALS_VARIABLE, Trials, planned_trials, trials_of
from prefect_robomaker.schemas.wire.common import MAX_SEED
from prefect_robomaker.schemas.wire.errors import InvalidParameterException

NAMES = st.text("ABC_", min_size=1, max_size=3)
VALUES = st.lists(st.text("xyz01.", min_size=1, max_size=3), min_size=1, max_size=4, unique=True)
NUMBERS = st.lists(st.floats(0.5, 2.0), min_size=1, max_size=3, unique=True)


@st.composite
def some_trials(draw: Any) -> Trials:
    """A grid of variables and numbers, or a design that draws both."""
    axes = variables(draw(st.dictionaries(NAMES, VALUES, max_size=3)))
    if draw(st.booleans()):
        axes["mass"] = {"kind": "robot_mass", "values": draw(NUMBERS)}
    members: dict[str, Any] = {"axes": axes} if axes else {}
    if axes and draw(st.booleans()):
        axes["noise"] = {"kind": "lidar_noise_std_m", "range": [0, 0.1]}
        design = draw(st.sampled_from(["random", "latin-hypercube", "sobol"]))
        members |= {"design": design, "points": draw(st.integers(1, 20))}
    return Trials.model_validate({"seeds": draw(st.integers(1, 20)), **members})


SOME_TRIALS = some_trials()


@given(SOME_TRIALS, st.integers(0, MAX_SEED))
def test_there_is_one_trial_of_each_seed_and_cell(trials: Trials, seed: int) -> None:
    all_trials = [trials.trial(number, seed) for number in range(trials.count)]

    axes = trials.axes or {}
    seeds = [(seed + offset) % (MAX_SEED + 1) for offset in range(trials.seeds)]
    assert [each.number for each in all_trials] == list(range(trials.cells * trials.seeds))
    assert [each.seed for each in all_trials] == seeds * trials.cells
    assert all(list(each.axes) == list(axes) for each in all_trials)
    cells = [each.axes for each in all_trials[:: trials.seeds]]
    assert [each.axes for each in all_trials] == [cell for cell in cells for _ in seeds]
    if trials.design == "grid":
        listed = [axis.listed or () for axis in axes.values()]
        assert cells == [dict(zip(axes, values, strict=True)) for values in itertools.product(*listed)]
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
    assert alone.simulation_application.environment_variables == {"A": "old", "Z": "1", **trial.variables}
    numbers = {name: value for name, value in trial.axes.items() if not isinstance(value, str)}
    assert {name: setting.value for name, setting in alone.axes.items()} == numbers
    assert alone.environment == {"A": "older", **trial.variables}


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


def test_trials_without_seeds_have_one_of_each_cell() -> None:
    trials = Trials.model_validate({"axes": variables({"SPEED": ["1", "2"]})})

    assert (trials.seeds, trials.count) == (1, 2)


def test_a_launch_variable_says_the_same_as_the_member() -> None:
    trials = {"seeds": 3, "axes": {"SPEED": {"kind": "variable", "values": ["0.2", "0.4"]}}}
    assert trials_of(order(trials)) == trials_of(order(variable=json.dumps(trials))) == Trials(**trials)
    assert trials_of(order(trials, json.dumps(trials))) == Trials(**trials)
    assert trials_of(order()) is None


SPEED = variables({"SPEED": ["1", "2"]})
MASS = {"mass": {"kind": "robot_mass", "values": [0.8, 1, 1.2]}}
RANGE = {"mass": {"kind": "robot_mass", "range": [0.8, 1.2]}}


@pytest.mark.parametrize(
    ("trials", "said"),
    [
        ({"seeds": 0}, r"trials\.seeds: is 0; it has to be at least 1"),
        ({"seeds": 2, "record": [2]}, r"record\[0\]: there is no trial 2; the trials are 0 to 1"),
        ({"seed": 2}, r"trials\.seed"),
        ({"seeds": 10**6, "axes": SPEED}, "are 2000000 trials; a job has at most 1000000"),
        ({"seeds": 1, "axes": {"SPEED": {"kind": "variable", "values": [0.2]}}},
         r"trials\.axes\.SPEED\.values\[0\]: is 0\.2; it has to be text"),
        ({"seeds": 1, "axes": variables({"SPEED": ["1", "1"]})}, "have to differ; '1' appears more than once"),
        ({"seeds": 1, "axes": variables({"speed": ["1"]})}, "speed: it is named after.*'SPEED' would be one"),
        ({"seeds": 1, "axes": variables({"ROBOMAKER_SEED": ["1"]})}, "ROBOMAKER_SEED cannot differ from trial"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mas", "values": [1]}}},
         r"trials\.axes\.m\.kind: is 'robot_mas'; did you mean 'robot_mass'"),
        ({"seeds": 1, "axes": {"Mass": MASS["mass"]}}, "Mass: an axis of kind robot_mass is named with small"),
        ({"seeds": 1, "axes": {**MASS, "weight": MASS["mass"]}}, "weight and mass are both of kind robot_mass"),
        ({"seeds": 1, "axes": {"all": {"kind": "motor_gain", "values": [1]},
                               "one": {"kind": "first_motor_gain", "values": [1]}}},
         r"one \(first_motor_gain\) and all \(motor_gain\) both change the force of motors; leave one out"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mass"}}}, "it has no values; give one of values, range"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mass", "values": [1], "range": [0.8, 1.2]}}},
         "values and range are given; give one of"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mass", "values": [1, "1.0"]}}}, "'1.0' appears more than once"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mass", "values": ["heavy"]}}}, "'heavy' is no number; robot_mass"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mass", "values": ["1_0"]}}}, "'1_0' is no number; robot_mass"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mass", "values": [" 1"]}}}, "' 1' is no number; robot_mass"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mass", "values": ["nan"]}}}, "'nan' is no number"),
        ({"seeds": 1, "axes": {"m": {"kind": "robot_mass", "values": [3.2, 80]}}},
         "80 is not possible; robot_mass is a factor from 0.1 to 10"),
        ({"seeds": 1, "design": "sobol", "points": 4, "axes": {"m": {"kind": "robot_mass", "range": [0, 1]}}},
         "range: 0 is not possible; robot_mass is a factor from 0.1 to 10"),
        ({"seeds": 1, "design": "sobol", "points": 4, "axes": {"m": {"kind": "robot_mass", "range": [2, 1]}}},
         "range: 2 is not below 1"),
        ({"seeds": 1, "design": "sobol", "points": 4,
          "axes": {"d": {"kind": "motor_delay_s", "normal": {"mean": 5, "std": 1}}}},
         "normal.mean: 5 is not between the bounds 0 and 1"),
        ({"seeds": 1, "axes": RANGE}, "axes.mass: a grid has values, and this is a range"),
        ({"seeds": 1, "axes": MASS, "points": 4}, "points: a grid has as many cells as its values make"),
        ({"seeds": 1, "axes": RANGE, "design": "sobol"}, "points is missing: a sobol design"),
        ({"seeds": 1, "axes": RANGE, "design": "soboll"}, "design: is 'soboll'; it has to be 'grid'"),
        ({"seeds": 1, "points": 3, "design": "random"}, "random spreads points over axes, and there are none"),
        ({"seeds": 1, "include": [{}]}, "include: its cells are of axes, and there are none"),
        ({"seeds": 1, "axes": MASS, "include": [{"mas": 1}]}, "there is no axis 'mas'; did you mean 'mass'"),
        ({"seeds": 1, "axes": MASS, "include": [{"mass": 0}]}, r"include\[0\]\.mass: 0 is not possible"),
        ({"seeds": 1, "axes": MASS, "include": [{"mass": 1}]}, r"include\[0\]: the grid has this cell already"),
        ({"seeds": 1, "axes": MASS, "include": [{}, {}]}, r"include\[1\]: it is there twice"),
        ({"seeds": 1, "axes": MASS, "exclude": [{"mass": 1.1}]}, r"exclude\[0\]\.mass: the axis has no value 1\.1"),
        ({"seeds": 1, "axes": MASS, "exclude": [{}]}, r"exclude\[0\]: it names no axis"),
        ({"seeds": 1, "axes": {**MASS, **SPEED}, "exclude": [{"SPEED": "1"}, {"SPEED": "2"}]}, "it leaves no cell"),
        ({"seeds": 1, "axes": RANGE, "design": "sobol", "points": 4, "exclude": [{"mass": 1}]},
         "exclude: it leaves cells out of a grid, and a sobol design has none"),
        ({"seeds": 1, "parameters": {"SPEED": ["1"]}}, r"trials\.parameters: is not known"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_trials_is_said(trials: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidParameterException, match=said):
        order(trials)
    with pytest.raises(InvalidParameterException, match=said.removeprefix(r"trials")):
        order(variable=json.dumps(trials))


def test_ten_axes_and_2000_trials_are_a_few_lines() -> None:
    page = (REPOSITORY / "docs" / "trials.md").read_text()
    [text] = [block for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL) if block.startswith("trials:")]
    trials = Trials.model_validate(YAML(typ="safe").load(text)["trials"])
    assert trials.axes is not None
    assert (len(trials.axes), trials.count) == (10, 2000)
    assert len(text.splitlines()) <= 16  # with the line that says `trials:`
    assert order(trials.to_wire()).trials == trials


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
    assert parse_request("CreateSimulationJob", {**request, "trials": {"seeds": 1}}), "nothing is begun anew"
    simulation = {"simulationApplications": request.pop("robotApplications"), "trials": {"seeds": 1}}
    with pytest.raises(InvalidParameterException, match=r"trials: simulationApplications\[0\].*factories"):
        parse_request("CreateSimulationJob", {**request, **simulation})
