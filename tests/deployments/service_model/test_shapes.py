"""Python types as shapes."""

from typing import Annotated, Literal

import pytest
from pydantic import Field

from prefect_robomaker.deployments.service_model.shapes import Shapes, as_html
from prefect_robomaker.schemas.wire.base import Shape, ShapeName
from prefect_robomaker.schemas.wire.common import Name, text

Answered = Annotated[list[Name], ShapeName("Names", 1, 5)]
Asked = Annotated[list[Name], ShapeName("Names"), Field(min_length=1, max_length=5)]


class Inner(Shape):
    """Inside."""

    flag: bool | None = Field(default=None, description="A flag.", json_schema_extra={"deprecated": True})


class Outer(Shape):
    """Holds `Inner`.

    More of it.
    """

    inner: Inner = Field(description="The inside.")
    answered: Answered | None = Field(default=None, description="Unbounded here.")
    asked: Asked | None = Field(default=None, description="Bounded here.")
    level: Annotated[Literal["LOW", "HIGH"], ShapeName("Level")] | None = Field(default=None, description="How much.")
    time_ms: Annotated[int, ShapeName("Millis", wire_type="long"), Field(ge=0)] = Field(description="How long.")


def test_a_structure_is_added_with_everything_it_holds() -> None:
    shapes = Shapes()

    assert shapes.add_structure(Outer) == "Outer"
    assert shapes.definitions == {
        "Outer": {
            "type": "structure",
            "required": ["inner", "time_ms"],
            "members": {
                "inner": {"shape": "Inner", "documentation": "<p>The inside.</p>"},
                "answered": {"shape": "Names", "documentation": "<p>Unbounded here.</p>"},
                "asked": {"shape": "Names", "documentation": "<p>Bounded here.</p>"},
                "level": {"shape": "Level", "documentation": "<p>How much.</p>"},
                "time_ms": {"shape": "Millis", "documentation": "<p>How long.</p>"},
            },
            "documentation": "<p>Holds <code>Inner</code>.</p><p>More of it.</p>",
        },
        "Inner": {
            "type": "structure",
            "members": {"flag": {"shape": "BoxedBoolean", "documentation": "<p>A flag.</p>", "deprecated": True}},
            "documentation": "<p>Inside.</p>",
        },
        "BoxedBoolean": {"type": "boolean"},
        "Name": {"type": "string", "min": 1, "max": 255, "pattern": r"[a-zA-Z0-9_\-]*"},
        "Names": {"type": "list", "member": {"shape": "Name"}, "min": 1, "max": 5},
        "Level": {"type": "string", "enum": ["LOW", "HIGH"]},
        "Millis": {"type": "long", "min": 0},
    }


class Unnamed(Shape):
    """Holds a type without a name."""

    values: list[Name] | None = Field(default=None, description="Some.")


def test_a_type_without_a_name_is_refused() -> None:
    with pytest.raises(ValueError, match=r"Unnamed\.values: list.* has no name; put a ShapeName into its metadata"):
        Shapes().add_structure(Unnamed)


class Twice(Shape):
    """Gives one name to two types."""

    first: Name = Field(description="The name.")
    second: Annotated[str, ShapeName("Name"), text(1, 10)] = Field(description="Another.")


def test_two_types_of_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match=r"Twice\.second: there are two shapes Name: .*255.* and .*10"):
        Shapes().add_structure(Twice)


def test_documentation_is_escaped() -> None:
    assert as_html("a < b & `c`\n  d\n\n\n  e") == "<p>a &lt; b &amp; <code>c</code> d</p><p>e</p>"
    assert as_html("") == ""
