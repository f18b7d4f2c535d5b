"""Worlds that a specification names by something else than their ARNs, and what takes the place of the names."""

import json

import jsonschema
import pytest

from prefect_robomaker.schemas.operations.registry import STEPS, parse_request
from prefect_robomaker.schemas.specs.check import load_request, load_spec
from prefect_robomaker.schemas.specs.json_schema import spec_schema
from prefect_robomaker.schemas.specs.resolving import resolve_input
from prefect_robomaker.schemas.specs.specification import CheckedSpec
from prefect_robomaker.schemas.specs.yaml_nodes import parse, plain
from prefect_robomaker.schemas.wire.errors import ConfigurationError, InvalidParameterException, SpecError
from prefect_robomaker.schemas.wire.operation_shape import CHANGES, READS
from prefect_robomaker.tasks.service.world_names import with_world_arns

SPEC = """\
version: 1
name: named
parameters:
  house: {default: flat 1}
steps:
  one: {operation: DescribeWorld, input: {world: "${{ parameters.house }}"}}
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        axes: {world: {values: [flat 1, "arn:old"]}, label: {values: [flat 1]}}
        include: [{world: flat 2, label: flat 1}]
        value: &job
          maxJobDurationInSeconds: 600
          tags: {label: "${{ label }}"}
          simulationApplications:
            - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: "${{ world }}"}]}
  each:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        forEach: [flat 2]
        as: world
        value:
          maxJobDurationInSeconds: 600
          simulationApplications:
            - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: "${{ world }}"}]}
  vary: {operation: VaryWorlds, input: {worlds: [flat 1], variations: [{light: night}]}}
"""


def found(name: str) -> str:
    if name not in ("flat 1", "flat 2"):
        raise ConfigurationError(f"{name!r} is no world")
    return f"arn:{name}"


def request(spec: CheckedSpec, step: str) -> str:
    return json.dumps(resolve_input(spec.steps[step], {}))


def test_names_stand_wherever_arns_of_worlds_may() -> None:
    spec = with_world_arns(load_spec(SPEC, "s.yaml"), found, found)

    assert json.loads(request(spec, "one")) == {"world": "arn:flat 1"}
    assert json.loads(request(spec, "vary"))["worlds"] == ["arn:flat 1"]
    assert '"world": "arn:flat 2"' in request(spec, "each")
    jobs = json.loads(request(spec, "drive"))["createSimulationJobRequests"]
    worlds = [job["simulationApplications"][0]["worldConfigs"][0]["world"] for job in jobs]
    assert worlds == ["arn:flat 1", "arn:old", "arn:flat 2"]
    assert {job["tags"]["label"] for job in jobs} == {"flat 1"}, "a text that is no world stays"


def test_names_that_mean_no_world_are_told_all_at_once_with_their_places() -> None:
    text = SPEC.replace("forEach: [flat 2]", "forEach: [flta 2]").replace("worlds: [flat 1]", "worlds: [flat 9]")

    with pytest.raises(SpecError) as caught:
        with_world_arns(load_spec(text, "s.yaml", {"house": "castle"}), found, found)

    assert [str(each) for each in caught.value.problems] == [
        "s.yaml:6:50: steps.one.input.world: 'castle' is no world",
        "s.yaml:22:19: steps.each.input.createSimulationJobRequests.forEach[0]: 'flta 2' is no world",
        "s.yaml:28:50: steps.vary.input.worlds[0]: 'flat 9' is no world",
    ]


def test_steps_that_delete_worlds_look_their_names_up_apart_and_each_name_is_told_once() -> None:
    text = SPEC + "  tidy: {operation: BatchDeleteWorlds, input: {worlds: [flat 1, flat 2]}}\n"
    told: list[tuple[str, str]] = []

    spec = with_world_arns(
        load_spec(text, "s.yaml"), found, lambda name: f"arn:only {name}", lambda *each: told.append(each)
    )

    assert json.loads(request(spec, "tidy")) == {"worlds": ["arn:only flat 1", "arn:only flat 2"]}
    assert json.loads(request(spec, "vary"))["worlds"] == ["arn:flat 1"]
    assert sorted(told) == [(name, f"arn:{how}{name}") for name in ("flat 1", "flat 2") for how in ("", "only ")]

    def refuse(name: str) -> str:
        raise ConfigurationError(f"{name!r} may be any of 2 worlds")

    with pytest.raises(SpecError) as caught:
        with_world_arns(load_spec(text, "s.yaml"), found, refuse, lambda *each: told.append(each))
    assert [each.path for each in caught.value.problems] == [f"steps.tidy.input.worlds[{index}]" for index in (0, 1)]
    assert len(told) == 4, "nothing is told where a name is refused"


def test_every_operation_that_deletes_or_changes_looks_its_names_up_apart() -> None:
    """An operation that is new is found here, so that somebody thinks about which worlds its names mean."""
    makes = ("Create", "Start", "Sync", "Restart", "Register", "Vary")
    assert [each for each in STEPS if not each.startswith((*CHANGES, *READS, *makes))] == []


def test_nothing_is_looked_up_where_all_are_arns_or_references() -> None:
    spec = load_spec(SPEC.replace("flat 1", "arn:a").replace("flat 2", "arn:b"), "s.yaml")

    assert with_world_arns(spec, found, found) is spec


def test_only_worlds_have_names_and_the_wire_takes_arns_only() -> None:
    with pytest.raises(SpecError, match=r"template: is 'flat'"):
        load_request("{template: flat, worldCount: {floorplanCount: 1}}", "r.yaml", "CreateWorldGenerationJob")
    for operation, members in (("DescribeWorld", {"world": "flat 1"}), ("BatchDeleteWorlds", {"worlds": ["flat 1"]})):
        with pytest.raises(InvalidParameterException, match="flat 1"):
            parse_request(operation, members)


def test_the_schema_for_editors_takes_names_too() -> None:
    validator = jsonschema.Draft202012Validator(spec_schema())

    assert [*validator.iter_errors(plain(parse(SPEC, "s.yaml")))] == []
    assert [*validator.iter_errors(plain(parse(SPEC.replace("worlds: [flat 1]", "worlds: [7]"), "s.yaml")))] != []


def test_a_variable_of_one_list_is_not_taken_for_a_world_in_the_next() -> None:
    """Both lists call their items `item`; the second one's were looked up as worlds."""
    text = (
        "version: 1\nname: twice\nsteps:\n  vary:\n    operation: VaryWorlds\n    input:\n"
        "      worlds: {forEach: [flat 1], value: '${{ item }}'}\n"
        "      variations: {forEach: [night], value: {light: '${{ item }}'}}\n"
    )
    made = json.loads(request(with_world_arns(load_spec(text, "s.yaml"), found, found), "vary"))
    assert made["worlds"] == ["arn:flat 1"]
    assert made["variations"] == [{"light": "night"}]
