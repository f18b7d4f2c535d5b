"""Parameters of specifications: what may be declared, which values they take, and where the values get."""

# ruff: noqa: E501 - a table with one case in a line reads best

import json
from typing import Any

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.json_schema import SCHEMA_FILE
from prefect_robomaker.schemas.specs.parameter_folding import fold_parameters
from prefect_robomaker.schemas.specs.parameter_values import param_options, set_options
from prefect_robomaker.schemas.specs.parameters import (
    AsText,
    Parameter,
    kind_of_parameters,
    settle,
)
from prefect_robomaker.schemas.specs.references import parse_template
from prefect_robomaker.schemas.specs.resolving import resolve_input
from prefect_robomaker.schemas.specs.yaml_nodes import MappingNode, parse, plain
from prefect_robomaker.schemas.wire.errors import SpecError

SPEC = """\
version: 1
name: flats
parameters:
  template: {type: string, default: flat, description: Template of the worlds}
  worlds: {type: integer, minimum: 1, maximum: 50, default: 4}
  arm: {enum: [a, b]}
steps:
  worlds:
    operation: CreateWorldGenerationJob
    input:
      template: arn:aws:robomaker:us-east-1:000000000000:world-template/${{ parameters.template }}
      worldCount: {floorplanCount: "${{ parameters.worlds }}", interiorCountPerFloorplan: 1}
      tags: {arm: "${{ parameters.arm }}", told: "${{ parameters.worlds }} in ${{ parameters.arm }}"}
  again:
    operation: CreateWorldGenerationJob
    input:
      template: ${{ worlds.template }}
      worldCount: {floorplanCount: 1, interiorCountPerFloorplan: 1}
      tags: {told: "${{ worlds.arn }} had ${{ parameters.worlds }}"}
"""


def problems(text: str, **given: Any) -> list[str]:
    with pytest.raises(SpecError) as caught:
        load_spec(text, "s.yaml", given)
    return [str(problem) for problem in caught.value.problems]


def declaring(declaration: str) -> str:
    """The specification with one more parameter, `more`."""
    return SPEC.replace("  arm:", f"  more: {declaration}\n  arm:")


def test_values_stand_where_they_are_referred_to_and_keep_their_type() -> None:
    spec = load_spec(SPEC, "s.yaml", {"arm": "b", "worlds": 20})

    request = plain(spec.steps["worlds"].input)
    assert request["worldCount"]["floorplanCount"] == 20
    assert isinstance(request["worldCount"]["floorplanCount"], int)
    assert request["template"].endswith(":world-template/flat")
    assert request["tags"] == {"arm": "b", "told": "20 in b"}
    assert spec.parameters == {"template": "flat", "worlds": 20, "arm": "b"}


def test_a_text_that_also_refers_to_a_step_gets_the_same_values_when_it_is_resolved() -> None:
    spec = load_spec(SPEC, "s.yaml", {"arm": "b", "worlds": 20})
    again = spec.steps["again"]

    request = resolve_input(again, {"worlds": {"arn": "ARN", "template": "arn:aws:robomaker:x:y:z/t"}})

    assert request["tags"] == {"told": "ARN had 20"}
    assert again.needs == ("worlds",), "parameters are no step to wait for"


def test_values_of_other_nights_are_not_mixed_up() -> None:
    """Texts are cached when they are parsed; values are not."""
    for worlds in (3, 7, 3):
        spec = load_spec(SPEC, "s.yaml", {"arm": "a", "worlds": worlds})
        assert plain(spec.steps["worlds"].input)["tags"]["told"] == f"{worlds} in a"
        made = resolve_input(spec.steps["again"], {"worlds": {"arn": "A", "template": "arn:aws:robomaker:x:y:z/t"}})
        assert made["tags"]["told"] == f"A had {worlds}"


@pytest.mark.parametrize(
    ("given_values", "problem"),
    [
        ({"arm": "a", "wolrds": 3}, "s.yaml:3:1: parameters: there is no parameter 'wolrds'; did you mean 'worlds'?"),
        ({"arm": "a", "q": 3}, "s.yaml:3:1: parameters: there is no parameter 'q'; there are template, worlds, arm"),
        ({}, "s.yaml:6:3: parameters.arm: has neither a value nor a default; give it one: --set arm=…, or arm=… in Python"),
        ({"arm": "c"}, "s.yaml:6:9: parameters.arm: the value given is 'c'; it has to be a or b"),
        ({"arm": "a", "worlds": 77}, "s.yaml:5:12: parameters.worlds: the value given is 77; it has to be a whole number from 1 to 50"),
        ({"arm": "a", "worlds": 0}, "s.yaml:5:12: parameters.worlds: the value given is 0; it has to be a whole number from 1 to 50"),
        ({"arm": "a", "worlds": "7"}, "s.yaml:5:12: parameters.worlds: the value given is '7'; it has to be a whole number from 1 to 50"),
        ({"arm": "a", "worlds": True}, "s.yaml:5:12: parameters.worlds: the value given is true; it has to be a whole number from 1 to 50"),
        ({"arm": "a", "worlds": 1.5}, "s.yaml:5:12: parameters.worlds: the value given is 1.5; it has to be a whole number from 1 to 50"),
        ({"arm": "a", "worlds": None}, "s.yaml:5:12: parameters.worlds: the value given is null; it has to be a whole number from 1 to 50"),
        ({"arm": "a", "worlds": [1]}, "s.yaml:5:12: parameters.worlds: the value given is a list; it has to be a whole number from 1 to 50"),
        ({"arm": "a", "template": 7}, "s.yaml:4:14: parameters.template: the value given is 7; it has to be text; put it in quotes: \"7\""),
        ({"arm": "a", "template": "x" * 3000}, f"s.yaml:4:14: parameters.template: the value given is '{'x' * 69}… (3002 characters); its length may be at most 2000"),
        ({"arm": "a", "template": "x\0"}, "s.yaml:4:14: parameters.template: the value given is 'x\\x00'; it may not hold the character U+0000"),
        ({"arm": "a", "worlds": AsText("many")}, "s.yaml:5:12: parameters.worlds: the value given is 'many'; it has to be a whole number from 1 to 50"),
    ],
)  # fmt: skip
def test_a_value_that_is_not_allowed_is_told_with_the_place_of_its_declaration(
    given_values: dict[str, Any], problem: str
) -> None:
    assert problems(SPEC, **given_values) == [problem]


def test_a_value_from_a_file_is_told_with_its_place_there() -> None:
    values = parse("arm: a\nworlds: 99\n", "values.yaml")
    assert isinstance(values, MappingNode)

    assert problems(SPEC, **values.entries) == [
        "values.yaml:2:9: parameters.worlds: the value given is 99; it has to be a whole number from 1 to 50"
    ]


def test_what_a_value_breaks_is_told_where_it_is_used() -> None:
    """The world count is refused by its operation, whatever the declaration allows."""
    (problem,) = problems(SPEC.replace("minimum: 1", "minimum: -5"), arm="a", worlds=-1)
    assert problem == (
        "s.yaml:12:36: steps.worlds.input.worldCount.floorplanCount: is -1; it has to be at least 1; "
        "the value is that of ${{ parameters.worlds }}"
    )


@pytest.mark.parametrize(
    ("declaration", "problem"),
    [
        ("{type: text}", "parameters.more.type: is 'text'; it has to be 'string', 'integer', 'number' or 'boolean'"),
        ("{typ: string, default: x}", "parameters.more.typ: is not known; did you mean 'type'?"),
        ("{type: integer, default: many}", "parameters.more.default: is 'many'; it has to be a whole number"),
        ("{type: integer, default: 0, minimum: 1}", "parameters.more.default: is 0; it has to be a whole number, at least 1"),
        ("{default: [1]}", "parameters.more.default: is a list; it has to be text"),
        ("{type: number, default: x, enum: [1.5, 2]}", "parameters.more.default: is 'x'; it has to be 1.5 or 2"),
        ("{enum: [fast, slow], default: fats}", "parameters.more.default: is 'fats'; it has to be fast or slow; did you mean 'fast'?"),
        ("{enum: []}", "parameters.more.enum: is an empty list; its length has to be at least 1"),
        ("{enum: [a, a]}", "parameters.more.enum[1]: is 'a', which is there twice; remove one"),
        ("{type: integer, enum: [1, b]}", "parameters.more.enum[1]: is 'b'; it has to be a whole number"),
        ("{minimum: 1}", "parameters.more.minimum: is for the type integer or number, and this is string; remove it, or change the type"),
        ("{type: number, minimum: 3, maximum: 2}", "parameters.more.minimum: is 3; it may be at most the maximum, 2"),
        ("{type: integer, pattern: x}", "parameters.more.pattern: is for the type string, and this is integer; remove it, or change the type"),
        ("{pattern: '('}", "parameters.more.pattern: is '('; it is no regular expression: unclosed group"),
        ("{pattern: '^a', default: ba}", "parameters.more.default: is 'ba'; it has to be text that matches ^a"),
    ],
)  # fmt: skip
def test_a_declaration_that_makes_no_sense_is_told_at_its_member(declaration: str, problem: str) -> None:
    told = problems(declaring(declaration), arm="a")
    assert [each.split(": ", 1)[1] for each in told] == [problem]
    assert told[0].startswith("s.yaml:6:")


@pytest.mark.parametrize(
    "name",
    ["spec", "text", "origin", "reuse", "continues", "parameters", "class", "from", "_x", "model_config", "wait_for"],
)
def test_names_of_the_flows_own_parameters_are_taken(name: str) -> None:
    (problem,) = problems(declaring("{default: x}").replace("  more:", f"  {name}:"), arm="a")
    assert problem.startswith(f"s.yaml:6:3: parameters.{name}: may not be named {name!r}")


def test_a_secret_is_no_parameter_as_its_value_would_be_shown() -> None:
    (problem,) = problems(declaring("{default: x}").replace("  more:", "  api_key:"), arm="a")
    assert problem.startswith("s.yaml:6:3: parameters.api_key: is a secret by its name; values of parameters are in")


@pytest.mark.parametrize(
    ("member", "problem"),
    [
        ('WIFI_PASSWORD: "${{ parameters.more }}"', "WIFI_PASSWORD: is a secret; "),
        ('WIFI_PASSWORD: "${{ parameters.more }}${{ one.arn }}"', "WIFI_PASSWORD: is a secret; "),
        # pragma: allowlist nextline secret
        ('ROBOMAKER_SECRETS: "A, PLAIN", PLAIN: "${{ parameters.more }}"', "PLAIN: is a secret; "),
        ('URL: "http://u:${{ parameters.more }}@h/"', "URL: has a login in a URL; "),
        ('URL: "http://h/${{ parameters.more }}"', ""),
    ],
)
def test_a_parameter_is_no_value_of_a_secret_variable(member: str, problem: str) -> None:
    launch = f"{{application: scout, launchConfig: {{environmentVariables: {{{member}}}}}}}"
    told = problems_of_a_job(f"robotApplications: [{launch}]")
    assert [each for each in told if " secret" in each or "login" in each] == [
        each for each in told if problem and problem in each
    ]
    assert bool(problem) == any(problem in each for each in told if problem)


def test_a_parameter_is_no_value_of_an_axis_that_is_a_secret() -> None:
    told = problems_of_a_job('trials: {axes: {API_KEY: {kind: variable, values: ["${{ parameters.more }}", "2"]}}}')
    assert any("trials.axes.API_KEY: is a secret; " in each for each in told)


def problems_of_a_job(members: str) -> list[str]:
    text = f"""\
version: 1
name: one
parameters: {{more: {{default: x}}}}
steps:
  drive:
    operation: CreateSimulationJob
    input:
      maxJobDurationInSeconds: 60
      iamRole: arn:aws:iam::000000000000:role/test
      {members}
"""
    try:
        load_spec(text, "s.yaml")
    except SpecError as error:
        return [str(each) for each in error.problems]
    return []


def test_the_names_that_are_taken_are_those_of_the_flow() -> None:
    from prefect_robomaker.flows.pipelines import RunPipeline
    from prefect_robomaker.schemas.specs.parameters import OWN_NAMES

    assert set(RunPipeline.parameters.properties) == set(OWN_NAMES)


def test_an_undeclared_parameter_is_told_with_the_nearest_name() -> None:
    text = SPEC.replace("parameters.worlds }} in", "parameters.wolrds }} in")
    assert problems(text, arm="a") == [
        "s.yaml:13:50: steps.worlds.input.tags.told: there is no parameter 'wolrds'; did you mean 'worlds'?"
    ]
    text = SPEC.replace("had ${{ parameters.worlds", "had ${{ parameters.wolrds")
    assert problems(text, arm="a") == [
        "s.yaml:19:20: steps.again.input.tags.told: there is no parameter 'wolrds'; did you mean 'worlds'?"
    ]


def test_without_a_declaration_a_reference_says_so() -> None:
    head, _, steps = SPEC.partition("parameters:\n")
    text = head + "steps:\n" + steps.partition("steps:\n")[2]
    assert {each.split(": ", 2)[2] for each in problems(text)} == {
        "there are no parameters: the specification declares none"
    }
    assert problems(one_step := text.replace("${{ parameters", "${{ worlds"), worlds=3)[0] == (
        "s.yaml:1:1: parameters: there is no parameter 'worlds'; the specification declares none"
    ), one_step


def test_no_step_and_no_variable_may_be_named_parameters() -> None:
    text = SPEC.replace("  again:", "  parameters:")
    assert problems(text, arm="a") == [
        "s.yaml:14:3: steps.parameters: no step may be named 'parameters', which references reach parameters by; "
        "choose another name"
    ]
    text = SPEC.replace(
        'tags: {told: "${{ worlds.arn }} had ${{ parameters.worlds }}"}',
        "tags: {forEach: [a], as: parameters, value: b}",
    )
    assert any("'parameters' already means something else" in each for each in problems(text, arm="a"))


def test_parameters_that_nothing_uses_are_fine_and_their_values_are_checked_all_the_same() -> None:
    text = declaring("{type: integer, default: 3, maximum: 5}")
    assert load_spec(text, "s.yaml", {"arm": "a"}).parameters["more"] == 3
    assert "it has to be a whole number, at most 5" in problems(text, arm="a", more=6)[0]


def test_types_come_from_choices_or_the_default() -> None:
    assert Parameter(enum=["a"]).value_type == "string"
    assert Parameter(enum=[1, 2.5]).value_type == "number"
    assert Parameter(default=True).value_type == "boolean"
    assert Parameter(default=1).value_type == "integer"
    assert Parameter().value_type == "string"


def test_text_of_a_command_line_is_read_by_the_parameters_type() -> None:
    declared = {
        "count": Parameter(type="integer"),
        "share": Parameter(type="number"),
        "fast": Parameter(type="boolean"),
        "label": Parameter(type="string"),
    }
    given_texts = {"count": "010", "share": "1e3", "fast": "true", "label": "010"}

    settled = settle(declared, {name: AsText(text) for name, text in given_texts.items()}, is_complete=True)

    assert settled.values == {"count": 10, "share": 1000.0, "fast": True, "label": "010"}


def test_a_whole_number_may_come_as_json_writes_it() -> None:
    settled = settle({"count": Parameter(type="integer")}, {"count": 4.0}, is_complete=True)
    assert settled.values == {"count": 4}
    assert isinstance(settled.values["count"], int)


def test_a_check_that_is_not_complete_says_what_is_missing_and_checks_the_rest() -> None:
    spec = load_spec(SPEC, "s.yaml", is_complete=False)
    assert spec.missing == ("arm",)
    with pytest.raises(SpecError, match="from 1 to 50"):
        load_spec(SPEC, "s.yaml", {"worlds": 77}, is_complete=False)


def test_expressions_of_parameters_are_computed_and_refused_where_they_give_nothing() -> None:
    text = SPEC.replace(
        '${{ parameters.arm }}", told', "${{ join('-', [parameters.arm, parameters.template]) }}\", told"
    )
    spec = load_spec(text, "s.yaml", {"arm": "a"})
    assert plain(spec.steps["worlds"].input)["tags"]["arm"] == "a-flat"

    text = SPEC.replace('${{ parameters.arm }}", told', '${{ [parameters.arm][3] }}", told')
    (problem,) = problems(text, arm="a")
    assert (
        problem
        == "s.yaml:13:19: steps.worlds.input.tags.arm: [parameters.arm][3] gives nothing: the output has no such value"
    )


def test_all_expressions_of_a_file_share_one_limit_of_work() -> None:
    """A stranger's file, which the console checks, may not keep it busy for hours."""
    doubled = "parameters.arm" + " | [@, @]" * 15
    tags = ", ".join(f'k{number}: "${{{{ length({doubled}) }}}}"' for number in range(100))
    text = SPEC.replace('arm: "${{ parameters.arm }}", told', f"{tags}, told")
    assert any("it makes too much" in each for each in problems(text, arm="a"))


def test_a_single_operation_may_have_parameters() -> None:
    text = """\
parameters: {worlds: {type: integer}}
operation: CreateWorldGenerationJob
input:
  template: arn:aws:robomaker:us-east-1:000000000000:world-template/x
  worldCount: {floorplanCount: "${{ parameters.worlds }}", interiorCountPerFloorplan: 1}
"""
    spec = load_spec(text, "one.yaml", {"worlds": 3})
    assert plain(spec.steps["one"].input)["worldCount"]["floorplanCount"] == 3
    assert problems(text) == [
        "s.yaml:1:14: parameters.worlds: has neither a value nor a default; give it one: --set worlds=…, or worlds=… in Python"
    ]


def test_a_specification_with_parameters_meets_the_json_schema() -> None:
    schema = json.loads(SCHEMA_FILE.read_bytes())
    jsonschema.validate(plain(parse(SPEC, "s.yaml")), schema)
    wrong = plain(parse(SPEC.replace("minimum: 1", "minimum: x"), "s.yaml"))
    with pytest.raises(jsonschema.ValidationError, match="'x' is not"):
        jsonschema.validate(wrong, schema)


texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20) | st.sampled_from(
    ["${{ worlds.arn }}", "$", "$${{ x }}", "{{ a }}", "}}", "${{"]
)


@given(texts, texts)
def test_nothing_in_a_value_is_a_reference(first: str, second: str) -> None:
    told = "a$${{ ${{ parameters.first }}{{${{ parameters.second }}"
    root = parse(
        json.dumps({"steps": {"one": {"input": {"told": told, "whole": "${{ parameters.first }}"}}}}), "s.json"
    )
    assert isinstance(root, MappingNode)
    declared = {"first": Parameter(), "second": Parameter()}

    folded, found = fold_parameters(root, kind_of_parameters(declared), {"first": first, "second": second})

    request = plain(folded)["steps"]["one"]["input"]
    assert not found
    assert parse_template(request["whole"]).value({}) == first
    assert parse_template(request["told"]).value({}) == f"a${{{{ {first}{{{{{second}"


@given(
    st.sampled_from([" 20", "NaN", "\t1", " true"]) | st.text("ab $'\"={}[]\\01-.", max_size=12),
    st.integers(),
    st.booleans(),
)
def test_the_words_that_repeat_a_run_give_the_same_values(label: str, count: int, fast: bool) -> None:
    declared = {"label": Parameter(), "count": Parameter(type="integer"), "fast": Parameter(type="boolean")}
    values = {"label": label, "count": count, "fast": fast}

    words = [word.partition("=")[::2] for word in set_options(values)[1::2]]
    read = settle(declared, {name: AsText(text) for name, text in words}, is_complete=True)
    assert read.values == values

    def as_prefect(text: str) -> Any:
        """As `prefect deployment run --param` reads it."""
        try:
            return json.loads(text)
        except ValueError:
            return text

    given_params = [word.removeprefix("--param=").partition("=")[::2] for word in param_options(values)]
    assert settle(declared, {n: as_prefect(t) for n, t in given_params}, is_complete=True).values == values
