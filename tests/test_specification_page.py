"""The page of the specification language names every construct, and its examples do what it says."""

import json
import re
from typing import Any, get_args

import pytest
from helpers.paths import REPOSITORY
from test_docs import blocks

from prefect_robomaker.schemas.operations.simulation_jobs import SimulationJobRequestMembers
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.json_schema import SCHEMA_FILE
from prefect_robomaker.schemas.specs.parameters import Parameter, ValueType
from prefect_robomaker.schemas.specs.references import parse_template
from prefect_robomaker.schemas.specs.specification import DEFAULT_VARIABLE, FOR_EACH_KEYS, INDEX, IfExists, Spec, Step
from prefect_robomaker.schemas.specs.step_axes import AXES_KEYS
from prefect_robomaker.schemas.worlds.step_operations import STEP_OPERATIONS

PAGE = REPOSITORY / "docs" / "specification.md"
TEXT = PAGE.read_text()
EXAMPLES = blocks(PAGE, "yaml")


def in_code(text: str) -> set[str]:
    """The words of a page's code spans, outside of its examples."""
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    return {word for span in re.findall("`([^`]+)`", prose) for word in re.findall(r"[\w$]+", span)}


def extensions() -> set[str]:
    members = SimulationJobRequestMembers.model_fields.items()
    return {name for name, field in members if (field.description or "").startswith("Extension:")}


def test_every_member_of_the_language_is_named() -> None:
    members = {*Spec.model_fields, *Step.model_fields, *Parameter.model_fields, *FOR_EACH_KEYS, *AXES_KEYS}
    values = {INDEX, DEFAULT_VARIABLE, *get_args(IfExists), *get_args(ValueType), *STEP_OPERATIONS, "axes"}

    assert members | values | extensions() <= in_code(TEXT)


def test_every_member_of_the_schema_is_named() -> None:
    schema: dict[str, Any] = json.loads(SCHEMA_FILE.read_text())
    parts = (schema["else"], *(schema["$defs"][name] for name in ("Step", "Parameter", "Single")))
    properties = {name for part in parts for name in part["properties"]}

    assert len(properties) > 10
    assert properties <= in_code(TEXT)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda text: text.splitlines()[1])
def test_examples_are_right_and_complete(example: str) -> None:
    spec = load_spec(example, PAGE.name)

    assert spec.order
    assert not spec.notes or "rover" in example


def test_every_construct_has_an_example() -> None:
    shown = "\n".join(EXAMPLES)

    constructs = (*Spec.model_fields, *Step.model_fields, *FOR_EACH_KEYS, *extensions() - {"policy"}, "axes")
    assert [name for name in constructs if not re.search(rf"\b{name}:", shown)] == []
    assert "${{ index }}" in shown
    assert all(operation in shown for operation in STEP_OPERATIONS)


def test_expressions_give_what_the_page_says() -> None:
    (outputs,) = map(json.loads, blocks(PAGE, "json"))
    _, _, table = TEXT.partition("| expression | value |\n| --- | --- |\n")
    rows = re.findall(r"^\| `(.+)` \| `(.+)` \|$", table.partition("\n\n")[0], re.MULTILINE)

    assert len(rows) >= 8
    for expression, value in rows:
        assert parse_template(f"${{{{ {expression} }}}}").value(outputs) == json.loads(value), expression


def test_the_command_says_what_the_page_says(robomaker, tmp_path, monkeypatch) -> None:
    (wrong,) = blocks(PAGE, "text")
    (shown,) = blocks(PAGE, "console")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wrong.yaml").write_text(wrong)
    command, _, said = shown.partition("\n")
    assert command == "$ robomaker validate wrong.yaml"

    ended = robomaker("validate", "wrong.yaml")

    assert (ended.code, ended.out, ended.err) == (2, "", said)


def test_errors_the_schema_and_the_readme_lead_here() -> None:
    path = "docs/specification.md"
    assert path in json.loads(SCHEMA_FILE.read_text())["description"]
    assert f"]({path})" in (REPOSITORY / "README.md").read_text()
