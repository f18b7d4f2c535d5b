"""Axes of a step: each cell becomes jobs, with the same seeds, and what is wrong has its place in the file."""

# ruff: noqa: E501 - a table with one case in a line reads best

import json
import math
from itertools import product
from typing import Any

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.deployments.cli.planning import jobs_of_axes, planned
from prefect_robomaker.schemas.runs.axes import AXIS_TAG, cell_in_tags, tag_in_words, tag_value
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.resolving import resolve_input
from prefect_robomaker.schemas.specs.specification import with_seed
from prefect_robomaker.schemas.wire.errors import SpecError

WORLDS = [f"arn:aws:robomaker:us-east-1:000000000000:world/generation-1/world-{number}" for number in (1, 2)]
OUTPUTS = {"list": {"worldSummaries": [{"arn": arn} for arn in WORLDS]}}


def spec_of(axes: Any, value: Any = None, **members: Any) -> str:
    """A specification with one step of axes, whose variable V has the values of all of them."""
    shown = "".join(f"${{{{ {name} }}}} " for name in axes)
    launch = {"environmentVariables": {"V": f"{shown}."}}
    request = {
        "maxJobDurationInSeconds": 60,
        "simulationApplications": [
            {"application": "indoor-navigation", "launchConfig": launch, "worldConfigs": [{"world": WORLDS[0]}]}
        ],
        **(value or {}),
    }
    requests = {"axes": axes, **members, "value": request}
    steps = {
        "list": {"operation": "ListWorlds"},
        "drive": {"operation": "StartSimulationJobBatch", "input": {"createSimulationJobRequests": requests}},
    }
    return json.dumps({"version": 1, "name": "axes", "steps": steps}, indent=1)


def requests_of(text: str) -> list[dict[str, Any]]:
    return resolve_input(load_spec(text, "axes.yaml").steps["drive"], OUTPUTS)["createSimulationJobRequests"]


def refused(text: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        load_spec(text, "axes.yaml")
    return [f"{each.path.removeprefix('steps.drive.input.createSimulationJobRequests.')}: {each.message}" for each in caught.value.problems]  # fmt: skip


def test_jobs_of_a_cell_that_is_drawn_again_have_the_next_seeds() -> None:
    for design in ("random", "latin-hypercube"):
        made = requests_of(spec_of({"v": {"values": ["a", "b"]}}, {"seed": 5}, design=design, points=5, seeds=2))
        told = {(each["seed"], each["tags"][f"{AXIS_TAG}v"]) for each in made}
        assert len(told) == len(made) == 10
    of_trials = {"trials": {"seeds": 2, "design": "random", "points": 3, "axes": {"V": {"kind": "variable", "values": ["a", "b"]}}}}  # fmt: skip
    made = requests_of(spec_of({"v": {"values": ["a", "b"]}}, {"seed": 5, **of_trials}, seeds=2))
    assert [each["seed"] for each in made] == [5, 9, 5, 9]  # each job has four seeds


def test_tags_and_axes_together_are_no_more_than_a_job_has() -> None:
    axes = {name: {"values": [1, 2]} for name in ("a", "b", "c")}
    most = {"tags": {f"t{number}": "x" for number in range(47)}}
    assert len(requests_of(spec_of(axes, most))[0]["tags"]) == 50
    assert refused(spec_of(axes, {"tags": {**most["tags"], "one": "more"}})) == [
        "value.tags: 48 tags and 3 for the axes are 51; a job has at most 50, so 47 would do"
    ]


SCALARS = st.text("abc,é= 1", min_size=1, max_size=5) | st.integers(-5, 5) | st.booleans()


@given(
    st.dictionaries(
        st.sampled_from(("robot", "speed", "door")),
        st.lists(SCALARS, min_size=1, max_size=4, unique=True),
        min_size=1,
    ),
    st.integers(1, 3),
    st.integers(1, 3),
)
@examples(30)
def test_no_cell_is_missing_and_each_has_the_same_seeds(axes: dict[str, list[Any]], seeds: int, of_trials: int) -> None:
    if any("true" in map(str, map(tag_value, values)) and "true" in values for values in axes.values()):
        return
    text = spec_of(
        {name: {"values": values} for name, values in axes.items()},
        {"seed": 5, "trials": {"seeds": of_trials}},
        seeds=seeds,
    )

    made = requests_of(text)

    cells = [tuple(each["tags"].items()) for each in made]
    wanted = {
        tuple((f"{AXIS_TAG}{name}", tag_value(value)) for name, value in zip(axes, values, strict=True))
        for values in product(*axes.values())
    }
    assert set(cells) == wanted
    # Trials of one job have seeds after each other: no other job of the cell repeats one.
    expected = [5 + number * of_trials for number in range(seeds)]
    assert all(
        [each["seed"] for each, at in zip(made, cells, strict=True) if at == cell] == expected for cell in wanted
    )
    assert len(made) == len(wanted) * seeds == jobs_of_axes(load_spec(text, "axes.yaml"))


@pytest.mark.parametrize(
    ("value", "said"), [("0.5", "stop = 0.5"), (0.5, "stop = 0.5"), ("a, b", "stop = a, b"), ("", "stop = ")]
)
def test_an_axis_in_tags_reads_as_it_was_written(value: str | float, said: str) -> None:
    assert tag_in_words(f"{AXIS_TAG}stop", tag_value(value)) == said


@given(st.text(max_size=20) | st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(10**9), 10**9))
@examples(100)
def test_tags_keep_values_of_axes(value: str | float) -> None:
    said = cell_in_tags({f"{AXIS_TAG}name": tag_value(value), "team": "night"})

    assert list(said) == ["name"]
    assert type(said["name"]) is (str if isinstance(value, str) else float)
    assert said["name"] == value
    assert all(each.isascii() and (each.isalnum() or each in " _.-/+=:") for each in tag_value(value))


def test_values_have_their_types_and_come_from_earlier_steps() -> None:
    axes = {
        "limit": {"values": [30, 60]},
        "world": {"values": "${{ list.worldSummaries[*].arn }}"},
        "robot": {"values": ["scout"]},
    }
    value = {
        "maxJobDurationInSeconds": "${{ limit }}",
        "simulationApplications": [
            {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": "${{ world }}"}]}
        ],
        "robotApplications": [{"application": "${{ robot }}", "launchConfig": {}}],
    }

    made = requests_of(spec_of(axes, value))

    assert load_spec(spec_of(axes, value), "axes.yaml").steps["drive"].needs == ("list",)
    assert [each["maxJobDurationInSeconds"] for each in made] == [30, 30, 60, 60]
    assert [each["simulationApplications"][0]["worldConfigs"][0]["world"] for each in made] == WORLDS * 2
    assert {each["robotApplications"][0]["application"] for each in made} == {"scout"}
    # Without a seed each job would draw its own, and none had a partner.
    assert [each["seed"] for each in requests_of(spec_of(axes, value, seeds=2))] == [0, 1] * 4


def test_designs_are_those_of_trials() -> None:
    axes = {
        "speed": {"range": [0.2, 0.6]},
        "mass": {"normal": {"mean": 1, "std": 0.1}},
        "robot": {"values": ["a", "b"]},
    }
    text = spec_of(
        axes, {"seed": 3}, design="sobol", points=8, include=[{"speed": 0.4, "mass": 1, "robot": "a"}], seeds=2
    )

    made = requests_of(text)
    cells = [cell_in_tags(each["tags"]) for each in made]

    assert len(made) == 18
    assert [cell["robot"] for cell in cells[::2]].count("b") == 4
    assert all(0.2 <= float(cell["speed"]) <= 0.6 for cell in cells)
    assert cells[-1] == {"speed": 0.4, "mass": 1.0, "robot": "a"}
    assert made == requests_of(text)
    assert cells != [cell_in_tags(each["tags"]) for each in requests_of(text.replace('"seed": 3', '"seed": 4'))]


def test_cells_may_be_left_out() -> None:
    axes = {"robot": {"values": ["a", "b"]}, "speed": {"values": [1, 2]}}

    made = requests_of(spec_of(axes, exclude=[{"robot": "b", "speed": 2}]))

    assert [(cell["robot"], cell["speed"]) for cell in (cell_in_tags(each["tags"]) for each in made)] == [
        ("a", 1.0), ("a", 2.0), ("b", 1.0),
    ]  # fmt: skip


def test_another_seed_for_the_whole_specification_is_that_of_each_cells_first_job() -> None:
    spec = with_seed(load_spec(spec_of({"robot": {"values": ["a", "b"]}}, seeds=2), "axes.yaml"), 40)

    made = resolve_input(spec.steps["drive"], OUTPUTS)["createSimulationJobRequests"]

    assert [each["seed"] for each in made] == [40, 41, 40, 41]


@pytest.mark.parametrize(
    ("axes", "members", "problem"),
    [
        ({"robot": {"kind": "variable", "values": ["a"]}}, {}, "axes.robot.kind: axes of a step have no kind"),
        ({"robot": {"values": ["a", "a"]}}, {}, "axes.robot: values have to differ; 'a' appears more than once"),
        ({"robot": {"values": ["25", "25"]}}, {}, "axes.robot: values have to differ; '25' appears more than once"),
        ({"robot": {"values": [1, 1.0]}}, {}, "axes.robot: values have to differ; 1.0 appears more than once"),
        ({"robot": {"values": [["a"]]}}, {}, "axes.robot.values[0]: is a list; a text, a number, true or false"),
        ({"robot": {}}, {}, "axes.robot: it has no values; give one of values, range"),
        ({"robot": {"range": [2, 1]}}, {"design": "sobol", "points": 2}, "axes.robot.range: 2 is not below 1"),
        ({"robot": {"range": [1, 2]}}, {}, "axes.robot: a grid has values, and this is a range"),
        ({"robot": {"values": ["a"]}}, {"design": "sobol"}, "points is missing: a sobol design has as many cells"),
        ({"robot": {"values": ["a"]}}, {"exclude": [{"robt": "a"}]}, "exclude[0].robt: there is no axis 'robt'; did you mean 'robot'?"),
        ({"robot": {"values": ["a"]}}, {"exclude": [{"robot": "b"}]}, "exclude[0].robot: the axis has no value 'b'; it has 'a'"),
        ({"a": {"values": ["a"]}, "b": {"values": ["b"]}}, {"include": [{"a": "x"}]}, "include[0]: has no value of b"),
        ({"list": {"values": ["a"]}}, {}, "axes.list: 'list' already means something else"),
        ({"API_KEY": {"values": ["a"]}}, {}, "axes.API_KEY: its name says that it is a secret"),
        ({"robot": {"values": ["a"]}}, {"seeds": 200_000}, "seeds: is 200000; it may be at most 100000"),
        ({"robot": {"values": ["a", "b"]}}, {"seeds": 60_000}, "60000 seeds for each of 2 cells are 120000 jobs; a step has at most 100000"),
        ({"robot": {"values": ["x" * 300]}}, {}, "is too long: a value is a tag of its job, of 256 characters"),
        ({"robot": {"values": "${{ list.nextToken }}"}}, {}, "axes.robot.values: ${{ list.nextToken }} is text; it has to be a list of values"),
        ({"robot": {"valeus": ["a"]}}, {}, "axes.robot.valeus: is not known; did you mean 'values'?"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_before_anything_runs(axes: Any, members: dict[str, Any], problem: str) -> None:
    assert any(problem in each for each in refused(spec_of(axes, **members)))


def test_misspelt_axes_are_one_problem() -> None:
    text = spec_of({"robot": {"values": ["a"]}}).replace('"axes":', '"axis":', 1)

    [told] = refused(text)

    assert told.endswith("axis: is not known; did you mean 'axes'?")


def test_axes_beside_a_for_each_are_one_problem() -> None:
    [told] = refused(spec_of({"robot": {"values": ["a"]}}, forEach=[1, 2], seeds=2))

    assert "createSimulationJobRequests: a list is made by forEach or by axes, not by both" in told


def test_an_axis_that_nothing_reads_is_refused() -> None:
    text = spec_of(
        {"robot": {"values": ["a", "b"]}}, {"simulationApplications": [{"application": "arena", "launchConfig": {}}]}
    )

    assert any("axes.robot: nothing in value refers to it" in each for each in refused(text))


def test_trials_may_not_have_an_axis_of_the_same_name() -> None:
    trials = {"seeds": 1, "axes": {"mass": {"kind": "robot_mass", "values": [1]}}}

    assert any("trials.axes.mass: the step has an axis 'mass' too" in each for each in refused(spec_of({"mass": {"values": ["a"]}}, {"trials": trials})))  # fmt: skip


def test_problems_have_their_line_and_column() -> None:
    text = spec_of({"robot": {"values": ["a"]}}, exclude=[{"robot": "b"}])
    [number] = [number for number, line in enumerate(text.splitlines(), start=1) if '"robot": "b"' in line]

    with pytest.raises(SpecError) as caught:
        load_spec(text, "axes.yaml")

    [problem] = caught.value.problems
    assert (problem.place.line, problem.place.column) == (number, text.splitlines()[number - 1].index('"b"') + 1)


def test_what_only_a_run_can_see_names_its_place_too() -> None:
    axes = {"world": {"values": "${{ list.worldSummaries[*].arn }}"}}
    text = spec_of(axes, exclude=[{"world": "arn:aws:robomaker:us-east-1:000000000000:world/other"}])

    with pytest.raises(SpecError, match=r"exclude\[0\]\.world: the axis has no value 'arn:.*/other'"):
        requests_of(text)
    with pytest.raises(SpecError, match=r"axes\.world\.values: is an empty list"):
        resolve_input(load_spec(spec_of(axes), "axes.yaml").steps["drive"], {"list": {"worldSummaries": []}})


def test_the_plan_says_how_many_jobs_there_are() -> None:
    axes = {"robot": {"values": ["a", "b"]}, "speed": {"values": [1, 2, 3]}}

    [step] = [each for each in planned(load_spec(spec_of(axes, seeds=4), "axes.yaml")) if each.step == "drive"]

    assert step.jobs == math.prod((2, 3, 4))
    assert step.detail.startswith("24 simulation jobs: 6 cells of robot × speed, 4 seeds each")


def test_seeds_alone_make_jobs_that_differ_in_nothing_else() -> None:
    text = spec_of({}, {"seed": 7}, seeds=3).replace('"axes": {},', "")

    assert [(each["seed"], each["tags"]) for each in requests_of(text)] == [(7, {}), (8, {}), (9, {})]
    assert jobs_of_axes(load_spec(text, "axes.yaml")) == 3


def test_true_is_not_1() -> None:
    """Python takes them for the same: excluding true left out 1."""
    words = "true and 1 are taken for each other; write one of them"
    assert refused(spec_of({"a": {"values": [1, True, 2]}})) == [f"axes.a: values: {words}"]
    assert refused(spec_of({"a": {"values": [1, 2]}}, exclude=[{"a": True}])) == [f"exclude[0].a: {words}"]
    assert [each["tags"] for each in requests_of(spec_of({"a": {"values": [True, False]}}, exclude=[{"a": True}]))] == [
        {f"{AXIS_TAG}a": "false"}
    ]


def test_names_and_cells_too_long_for_tags_are_refused_before_anything_runs() -> None:
    assert "is too long: a value is a tag" in refused(spec_of({"a": {"values": [1]}}, include=[{"a": "x" * 257}]))[0]
    assert refused(spec_of({"a" * 114: {"values": [1]}})) == [
        f"axes.{'a' * 114}: is too long: it is in a tag of its jobs; 113 characters would do"
    ]


def test_an_axis_that_is_a_list_by_reference_is_refused_before_anything_runs() -> None:
    [found] = refused(spec_of({"a": "${{ list.worldSummaries[*].arn }}"}))
    assert "it has to be a mapping: values: ${{ list.worldSummaries[*].arn }}" in found


def test_a_seed_that_is_none_stays_wrong() -> None:
    """It was taken modulo the seeds there are, so that -5 became a large one."""
    text = spec_of({"a": {"values": [-5]}}, {"seed": "${{ a }}"}, seeds=2)
    with pytest.raises(SpecError) as caught:
        requests_of(text)
    assert "seed" in str(caught.value)
