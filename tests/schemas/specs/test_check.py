"""Checking specifications: what runs, and what every mistake says."""

# ruff: noqa: E501 - a table with one case in a line reads best

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.schemas.roles import LOCAL_ROLE
from prefect_robomaker.schemas.specs.check import load_request, load_spec
from prefect_robomaker.schemas.specs.json_schema import SCHEMA_FILE, schema_text
from prefect_robomaker.schemas.specs.resolving import resolve_input
from prefect_robomaker.schemas.specs.specification import output_model, with_seed
from prefect_robomaker.schemas.specs.yaml_nodes import parse, plain
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, SpecError

SPECS = REPOSITORY / "deployments" / "specs"
EXAMPLES = sorted(SPECS.glob("*.yaml"))

GOOD = """\
version: 1
name: two-flats
steps:
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        forEach: ${{ worlds.finishedWorldsSummary.succeededWorlds }}
        as: world
        value:
          iamRole: arn:aws:iam::000000000000:role/local
          maxJobDurationInSeconds: 300
          robotApplications: [{application: scout, launchConfig: {}}]
          simulationApplications:
            - application: indoor-navigation
              launchConfig: {environmentVariables: {NUMBER: "${{ index }} of many"}}
              worldConfigs: [{world: "${{ world }}"}]
  worlds:
    operation: CreateWorldGenerationJob
    input: {template: "${{ template.arn }}", worldCount: {floorplanCount: 2, interiorCountPerFloorplan: 1}}
  template:
    operation: CreateWorldTemplate
    input:
      name: flat
      templateBody: {Version: "1"}
"""


def problems(text: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        load_spec(text, "s.yaml")
    return [str(problem) for problem in caught.value.problems]


def one_step(step: str) -> str:
    return f"version: 1\nname: one\nsteps:\n  first:\n    {step}\n"


# What runs


def test_steps_run_after_those_they_refer_to() -> None:
    spec = load_spec(GOOD, "s.yaml")
    assert spec.name == "two-flats"
    assert spec.order == ("template", "worlds", "drive")
    assert spec.steps["drive"].needs == ("worlds",)
    assert spec.text == GOOD


def test_needs_add_to_the_order() -> None:
    text = GOOD.replace("  template:\n", "  other:\n    operation: ListWorlds\n    needs: [drive]\n  template:\n")
    assert load_spec(text, "s.yaml").order == ("template", "worlds", "drive", "other")


def test_for_each_makes_one_entry_for_each_and_keeps_kinds() -> None:
    spec = load_spec(GOOD, "s.yaml")
    outputs = {"worlds": {"finishedWorldsSummary": {"succeededWorlds": ["arn:a", "arn:b"]}}}
    requests = resolve_input(spec.steps["drive"], outputs)["createSimulationJobRequests"]
    applications = [request["simulationApplications"][0] for request in requests]
    assert [each["worldConfigs"] for each in applications] == [[{"world": "arn:a"}], [{"world": "arn:b"}]]
    assert applications[1]["launchConfig"]["environmentVariables"] == {"NUMBER": "1 of many"}
    assert requests[0]["maxJobDurationInSeconds"] == 300


def test_for_each_goes_through_a_list_in_the_file() -> None:
    text = """\
operation: BatchDescribeSimulationJob
jobs:
  forEach: [a, b]
  value: arn:${{ item }}${{ index }}
"""
    spec = load_spec(text, "s.yaml")
    assert resolve_input(spec.steps[spec.order[0]], {}) == {"jobs": ["arn:a0", "arn:b1"]}


def test_template_bodies_become_json_text() -> None:
    spec = load_spec(GOOD, "s.yaml")
    assert resolve_input(spec.steps["template"], {}) == {"name": "flat", "templateBody": '{"Version": "1"}'}


def test_job_steps_give_their_final_description() -> None:
    assert output_model("StartSimulationJobBatch") is OPERATIONS["DescribeSimulationJobBatch"].response
    assert output_model("CreateSimulationJob") is OPERATIONS["DescribeSimulationJob"].response
    assert output_model("CreateWorldExportJob") is OPERATIONS["DescribeWorldExportJob"].response
    assert output_model("CreateWorldTemplate") is OPERATIONS["CreateWorldTemplate"].response
    jobs = [name for name, operation in OPERATIONS.items() if operation.is_job]
    assert all(output_model(name).__name__.startswith("Describe") for name in jobs)


@pytest.mark.parametrize(
    "text",
    [
        "operation: DescribeWorld\nworld: arn:1",
        "operation: DescribeWorld\ninput: {world: arn:1}",
        "version: 1\nname: it\noperation: DescribeWorld\ninput: {world: arn:1}",
        '{"operation": "DescribeWorld", "world": "arn:1"}',
    ],
)
def test_a_file_may_be_a_single_operation(text: str) -> None:
    spec = load_spec(text, "folder/my file.v2.yaml")
    assert spec.name in ("my-file", "it")
    (step,) = spec.steps.values()
    assert resolve_input(step, {}) == {"world": "arn:1"}


def test_a_single_operation_has_nothing_to_refer_to() -> None:
    (problem,) = problems("operation: DescribeWorld\nworld: ${{ worlds.arn }}")
    assert "no step or variable 'worlds'; this file has no steps to refer to" in problem


def test_the_name_member_of_a_single_operation_is_the_operations_own() -> None:
    spec = load_spec("operation: CreateWorldTemplate\nname: my flat\ntemplateBody: {}", "flat.yaml")
    assert spec.name == "flat"
    assert resolve_input(spec.steps["flat"], {})["name"] == "my flat"


def test_requests_are_taken_as_the_aws_cli_takes_them() -> None:
    spec = load_request('{"world": "arn:1"}', "body.json", "DescribeWorld")
    assert resolve_input(spec.steps[spec.order[0]], {}) == {"world": "arn:1"}
    with pytest.raises(SpecError, match=r"(?m)^body.yaml:2:1: wrld: is not known; did you mean 'world'\?"):
        load_request("# body\nwrld: arn:1", "body.yaml", "DescribeWorld")
    with pytest.raises(InvalidParameterException, match="did you mean 'DescribeWorld'"):
        load_request("{}", "body.yaml", "DescribeWold")


def test_a_seed_can_be_put_in_place_of_all_others() -> None:
    spec = with_seed(load_spec((SPECS / "quickstart.yaml").read_text(), "q.yaml"), 99)
    outputs: dict[str, Any] = {
        "template": {"arn": "arn:t"},
        "worlds": {"finishedWorldsSummary": {"succeededWorlds": ["arn:a", "arn:b"]}},
    }
    assert resolve_input(spec.steps["worlds"], outputs)["seed"] == 99
    requests = resolve_input(spec.steps["drive"], outputs)["createSimulationJobRequests"]
    assert [request["seed"] for request in requests] == [99, 99]
    assert "seed" not in resolve_input(spec.steps["template"], outputs)


def test_a_copy_for_others_has_no_secrets_and_runs() -> None:
    """One without secrets is what was written, with comments and all."""
    assert load_spec(GOOD, "s.yaml").text_for_others == GOOD
    variables = '{NUMBER: "${{ index }} of many", X_TOKEN: hunter2, ROBOMAKER_SECRETS: MINE, MINE: "häß-lich"}'
    secret = GOOD.replace('{NUMBER: "${{ index }} of many"}', variables) + "# the token is hunter2\n"

    copy = load_spec(secret, "s.yaml").text_for_others

    assert "hunter2" not in copy
    assert "häß" not in copy
    shown = load_spec(copy.replace("(secret)", "hunter2"), "s.yaml")
    assert shown.order == load_spec(GOOD, "s.yaml").order
    assert plain(parse(copy, "s.yaml"))["steps"]["worlds"] == plain(parse(GOOD, "s.yaml"))["steps"]["worlds"]


# What is wrong


def test_all_problems_are_found_at_once_in_file_order() -> None:
    text = GOOD.replace("name: two-flats", "name: two flats").replace("forEach:", "foreach:")
    text = text.replace("${{ template.arn }}", "${{ template.name.first }}").replace("300", '"300"')
    found = problems(text)
    places = [tuple(map(int, each.split(":")[1:3])) for each in found]
    assert places == sorted(places)
    assert {line for line, _ in places} >= {2, 8, 20}


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("version: 1", "version: 2", "s.yaml:1:10: version: is 2; it has to be 1"),
        ("name: two-flats", "name: two-flats\nremark: x", "s.yaml:3:1: remark: is not known; known are version, name"),
        ("    input: {template", "    inputs: {template", "s.yaml:20:5: steps.worlds.inputs: is not known; did you mean 'input'?"),
        ("CreateWorldTemplate", "CreateWorldTemplat", "s.yaml:22:16: steps.template.operation: there is no operation 'CreateWorldTemplat'; did you mean 'CreateWorldTemplate'?"),
        ("name: flat", "nam: flat", "s.yaml:24:7: steps.template.input.nam: is not known; did you mean 'name'?"),
        ("name: flat", "name: 12", 's.yaml:24:13: steps.template.input.name: is 12; it has to be text; put it in quotes: "12"'),
        ('{Version: "1"}', '{Version: "1", Building: []}', 's.yaml:25:36: steps.template.input.templateBody.Building: unknown member; did you mean "Buildings"?'),
        ('{Version: "1"}', "{Version: '3'}", 's.yaml:25:31: steps.template.input.templateBody.Version: "3"'),
        ('{Version: "1"}', "'{\"Version\": \"3\"}'", "s.yaml:25:21: steps.template.input.templateBody.Version"),
        ('{Version: "1"}', "'{broken'", "s.yaml:25:21: steps.template.input.templateBody: templateBody: not JSON"),
        ("${{ template.arn }}", "${{ templates.arn }}", "s.yaml:20:23: steps.worlds.input.template: there is no step or variable 'templates'; did you mean 'template'?"),
        ("${{ template.arn }}", "${{ template.body }}", "s.yaml:20:23: steps.worlds.input.template: CreateWorldTemplateResponse has no member 'body'"),
        ("${{ template.arn }}", "${{ worlds.arn }}", "s.yaml:18:3: steps.worlds: refers to itself"),
        ("${{ template.arn }}", "${{ drive.arn }}", "these steps wait for each other: "),
        ("${{ worlds.finishedWorldsSummary.succeededWorlds }}", "${{ worlds.arn }}", "s.yaml:8:18: steps.drive.input.createSimulationJobRequests.forEach: is ${{ worlds.arn }}, text; it has to be a list"),
        ("as: world", "as: worlds", "s.yaml:9:13: steps.drive.input.createSimulationJobRequests.as: 'worlds' already means something else"),
        ("as: world", "as: index", "'index' already means something else"),
        ("as: world", "az: world", "s.yaml:9:9: steps.drive.input.createSimulationJobRequests.az: is not known"),
        ("${{ world }}", "${{ index }}", "simulationApplications[0].worldConfigs[0].world: ${{ index }} is a whole number; it has to be text; to_string(…) makes text of it"),
        ("300", "${{ world }}", "s.yaml:12:36: steps.drive.input.createSimulationJobRequests.value.maxJobDurationInSeconds: ${{ world }} is text; it has to be a whole number"),
        ("maxJobDurationInSeconds: 300", "failureBehavior: Fail", "s.yaml:10:9: steps.drive.input.createSimulationJobRequests.value.maxJobDurationInSeconds: is missing"),
        ("NUMBER", "number", "environmentVariables.number: the key is 'number'; it has to be of capital letters"),
        ("floorplanCount: 2", "floorplanCount: 0", "s.yaml:20:75: steps.worlds.input.worldCount.floorplanCount: is 0; it has to be at least 1"),
        ("{floorplanCount: 2, interiorCountPerFloorplan: 1}", '"${{ template.arn }}"', "is text; it has to be a mapping (WorldCount)"),
        ('"${{ template.arn }}"', "${{ template.arn }}", 's.yaml:20:24: this is not YAML: while parsing a flow mapping, expected \',\' or'),
        ('"${{ template.arn }}"', "${{ template.arn }}", 'inside braces or brackets a reference needs quotes: "${{ … }}"'),
    ],
)  # fmt: skip
def test_each_mistake_says_where_it_is_and_what_would_be_right(before: str, after: str, expected: str) -> None:
    assert before in GOOD
    found = problems(GOOD.replace(before, after, 1))
    assert any(expected in each for each in found), found


def test_one_mistake_gives_one_problem() -> None:
    assert len(problems(GOOD.replace("templateBody: {", "templateBdy: {"))) == 1
    assert len(problems(GOOD.replace("${{ world }}", "${{ wrold }}"))) == 1
    assert len(problems(GOOD.replace("CreateWorldTemplate", "CreateTemplate"))) == 1


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        ("{operation: ListWorlds, needs: [frist]}", "s.yaml:5:37: steps.first.needs[0]: there is no step 'frist'; did you mean 'first'?"),
        ("{operation: ListWorlds, ifExists: reuse}", "s.yaml:5:39: steps.first.ifExists: 'reuse' is for CreateRobotApplication"),
        ("{operation: ListWorlds, ifExists: update}", "s.yaml:5:39: steps.first.ifExists: 'update' is for CreateRobotApplication"),
        ("{operation: CreateWorldTemplate, ifExists: update}", "steps.first.ifExists: 'update' is not for CreateWorldTemplate; 'reuse' or 'fail' would be right"),
        ("{operation: ListWorlds, ifExists: maybe}", "s.yaml:5:39: steps.first.ifExists: is 'maybe'; it has to be 'fail', 'reuse' or 'update'"),
        ("{operation: [ListWorlds]}", "s.yaml:5:17: steps.first.operation: is ['ListWorlds']; it has to be text"),
        ("{operation: ListWorlds, input: all}", "s.yaml:5:36: steps.first.input: is 'all'; it has to be a mapping"),
        ("{input: {}}", "steps.first.operation: is missing"),
        ("{operation: DescribeWorld}", "s.yaml:5:6: steps.first.input.world: is missing"),
        ("just text", "steps.first: is 'just text'; it has to be a mapping"),
    ],
)  # fmt: skip
def test_mistakes_in_a_step(step: str, expected: str) -> None:
    found = problems(one_step(step))
    assert any(expected in each for each in found), found


@pytest.mark.parametrize("text", ["[1, 2]", "just text", "version: 1", "{}", "steps: {}", "steps: 5", "operation: 7"])
def test_whatever_is_no_specification_is_refused(text: str) -> None:
    assert problems(text)


def test_step_names_have_to_be_usable_in_references() -> None:
    found = problems(GOOD.replace("  template:\n", "  my-template:\n"))
    assert found[-1].startswith("s.yaml:21:3: steps.my-template: the key is 'my-template'")


def test_rules_about_values_wait_until_the_values_are_known() -> None:
    text = """\
version: 1
name: archives
steps:
  world: {operation: DescribeWorld, input: {world: arn:1}}
  drive:
    operation: CreateSimulationJob
    input:
      iamRole: arn:aws:iam::0:role/x
      maxJobDurationInSeconds: 60
      simulationApplications: [{application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: "arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1"}]}]
      dataSources:
        - {name: worlds, type: Archive, s3Bucket: robomaker, s3Keys: ["${{ world.arn }}"]}
"""
    spec = load_spec(text, "s.yaml")
    with pytest.raises(SpecError, match=r"s.yaml:12:.*dataSources\[0\]: keys of type Archive have to end in"):
        resolve_input(spec.steps["drive"], {"world": {"arn": "arn:1"}})


def test_a_reference_that_gives_nothing_says_where_it_stands() -> None:
    spec = load_spec(GOOD, "s.yaml")
    with pytest.raises(SpecError) as caught:
        resolve_input(spec.steps["worlds"], {"template": {}})
    assert str(caught.value).startswith("s.yaml:20:23: steps.worlds.input.template: template.arn gives nothing")


def test_an_entry_that_for_each_made_wrong_is_named_by_its_position() -> None:
    spec = load_spec(GOOD, "s.yaml")
    outputs = {"worlds": {"finishedWorldsSummary": {"succeededWorlds": ["arn:a", "no arn"]}}}
    with pytest.raises(SpecError) as caught:
        resolve_input(spec.steps["drive"], outputs)
    assert str(caught.value).startswith("s.yaml:17:38: steps.drive.input.createSimulationJobRequests[1].simulation")


# The examples and the schema


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_the_examples_are_right(path: Path) -> None:
    assert load_spec(path.read_text(), path.name).order


def test_the_committed_schema_is_current() -> None:
    assert SCHEMA_FILE.read_text() == schema_text(), "run python -m prefect_robomaker.schemas.specs.json_schema"


@pytest.fixture(scope="module")
def schema() -> jsonschema.Draft202012Validator:
    document = json.loads(SCHEMA_FILE.read_text())
    jsonschema.Draft202012Validator.check_schema(document)
    return jsonschema.Draft202012Validator(document)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_the_schema_takes_the_examples(path: Path, schema: jsonschema.Draft202012Validator) -> None:
    assert [error.message for error in schema.iter_errors(plain(parse(path.read_text(), path.name)))] == []


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("name: flat", "nam: flat"),
        ("name: flat", "name: 12"),
        ("CreateWorldTemplate", "CreateTemplate"),
        ('{Version: "1"}', '{Version: "1", Building: []}'),
        ("floorplanCount: 2", "floorplanCount: 0"),
        ("as: world", "az: world"),
        ("version: 1", "version: 2"),
    ],
)
def test_the_schema_finds_mistakes(before: str, after: str, schema: jsonschema.Draft202012Validator) -> None:
    assert list(schema.iter_errors(plain(parse(GOOD, "s")))) == []
    assert list(schema.iter_errors(plain(parse(GOOD.replace(before, after, 1), "s"))))


def many_steps(count: int) -> str:
    lines = (f"  s{number}: {{operation: ListRobots{needs(number)}}}\n" for number in range(count))
    return f"version: 1\nname: many\nsteps:\n{''.join(lines)}"


def needs(number: int) -> str:
    return f", needs: [s{number - 1}]" if number % 2 else ""


def test_a_thousand_steps_are_read_and_stand_in_file_order() -> None:
    assert load_spec(many_steps(1000), "x.yaml").order == tuple(f"s{number}" for number in range(1000))


def test_more_steps_than_a_thousand_are_one_problem() -> None:
    (problem,) = problems(many_steps(1001))
    assert problem.startswith("s.yaml:4:3: steps: is a mapping with s0, s1, ")
    assert problem.endswith("… (1001 members); its length may be at most 1000")


def test_of_many_steps_a_message_names_some() -> None:
    text = many_steps(200) + "  other: {operation: ListRobots, needs: [quite_another]}\n"
    (problem,) = problems(text)
    assert "there is no step 'quite_another'; there are s0, s1, " in problem
    assert problem.endswith("s49, …")


def test_a_member_whose_name_is_endless_is_told_at_once() -> None:
    """Its name is cut off in the message, in the middle of a quoted word; that once took longer than anybody waits."""
    body = {"Version": "1", "Buildings": [{"Floors": [{"Floorplan": {"Rooms": [{"De" + "[" * 200: 1}]}}]}]}
    step = {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": body}}

    problem, *_ = problems(json.dumps({"version": 1, "name": "n", "steps": {"template": step}}))

    assert "unknown member" in problem


@pytest.mark.parametrize(
    ("operation", "default"),
    [("CreateWorldTemplate", "reuse"), ("CreateRobotApplication", "fail"), ("ListWorlds", "fail")],
)
def test_only_templates_are_taken_where_nothing_is_said(operation: str, default: str) -> None:
    inputs = {
        "CreateWorldTemplate": {"name": "flat", "templateBody": {"Version": "1"}},
        "CreateRobotApplication": {
            "name": "rover",
            "environment": {"uri": "python://rover.main"},
            "robotSoftwareSuite": {"name": "General"},
        },
        "ListWorlds": {},
    }
    spec = {"version": 1, "name": "s", "steps": {"a": {"operation": operation, "input": inputs[operation]}}}
    assert load_spec(json.dumps(spec), "s.json").steps["a"].if_exists == default


@pytest.mark.parametrize(
    "step",
    [
        "operation: CreateWorldExportJob\n    input: {worlds: [arn:1], outputLocation: {s3Bucket: bucket, s3Prefix: p}}",
        "operation: CreateSimulationJob\n    input: {maxJobDurationInSeconds: 60, robotApplications: [{application: a, launchConfig: {}}]}",
    ],
)  # fmt: skip
def test_a_step_that_names_no_role_has_that_of_calls_in_python(step: str) -> None:
    world = "arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1"
    spec = load_spec(f"version: 1\nname: roles\nsteps:\n  made:\n    {step}".replace("arn:1", world), "s.yaml")

    assert resolve_input(spec.steps["made"], {})["iamRole"] == LOCAL_ROLE
    text = f"version: 1\nname: roles\nsteps:\n  made:\n    {step}"
    jsonschema.validate(plain(parse(text, "s.yaml")), json.loads(SCHEMA_FILE.read_text()))


def test_a_misspelt_role_is_told_with_the_name_that_was_meant() -> None:
    text = "version: 1\nname: roles\nsteps:\n  made:\n    operation: CreateWorldExportJob\n    input: {iamRol: x}\n"
    with pytest.raises(SpecError, match=r"iamRol: is not known; did you mean 'iamRole'"):
        load_spec(text, "s.yaml")
