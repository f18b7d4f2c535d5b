"""The bodies that the reference shows are right."""

import re

import pytest
from helpers.paths import REPOSITORY
from pydantic import TypeAdapter

from prefect_robomaker.schemas.templates.body import ModelType
from prefect_robomaker.schemas.templates.parsing import parse_template_body

PAGE = REPOSITORY / "docs" / "world-templates.md"
EXAMPLES = re.findall(r"^```json\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("text", EXAMPLES)
def test_each_example_is_a_body_of_version_2(text: str) -> None:
    body = parse_template_body(text)
    assert body.Version == "2"
    assert parse_template_body(body.canonical()) == body


def test_the_reference_shows_a_door_of_each_kind() -> None:
    assert len(EXAMPLES) == 2
    sets = parse_template_body(EXAMPLES[1]).interior.Doorways
    assert sets is not None
    assert [one.Door.InitialState.OpenPosition.Percent for one in sets.DoorwaySets] == [0, "Random"]


def test_the_reference_lists_all_kinds_of_furniture() -> None:
    listed = re.search(r"^`ModelTypes` are (.*?)\.$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert listed is not None
    kinds = TypeAdapter(ModelType).json_schema()["enum"]
    assert re.findall(r"[A-Z]\w+", listed[1]) == kinds
