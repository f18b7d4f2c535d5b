"""Facts of members, as pydantic's schemas have them."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field

from tools.promises.facts import Fact
from tools.promises.from_schemas import facts_of_models


class Part(BaseModel):
    size: float = Field(gt=0, le=9)


class Other(BaseModel):
    size: int = 3


class Whole(BaseModel):
    name: str = Field(min_length=1, pattern="^a")
    kind: Literal["one", "two"] | None = None
    parts: list[Part | Other] = Field(default=[], max_length=5)
    tags: dict[str, Annotated[str, Field(max_length=7)]] = {}
    wide: Annotated[int, Field(ge=3)] | Annotated[float, Field(ge=1)] = 4


def types(*names: str) -> frozenset[str]:
    return frozenset(names)


def test_what_users_give_has_types_limits_and_defaults() -> None:
    assert facts_of_models([Whole], "taken") == {
        "Whole.name": Fact(taken=types("string"), required=True, least=1, pattern="^a"),
        "Whole.kind": Fact(taken=types('"one"', '"two"', "null")),
        "Whole.parts": Fact(taken=types("array"), default="[]", most=5),
        "Whole.parts[]": Fact(taken=types("Part", "Other")),
        "Whole.tags": Fact(taken=types("map"), default="{}"),
        "Whole.tags{}": Fact(taken=types("string"), most=7),
        "Whole.wide": Fact(taken=types("integer", "number"), default="4", least=1),
        "Part.size": Fact(taken=types("number"), required=True, above=0, most=9),
        "Other.size": Fact(taken=types("integer"), default="3"),
    }


def test_what_users_get_has_types_only() -> None:
    facts = facts_of_models([Whole], "given")

    assert facts["Whole.name"] == Fact(given=types("string"), required=True)
    assert facts["Whole.parts"] == Fact(given=types("array"))
    assert facts["Whole.parts[]"] == Fact(given=types("Part", "Other"))
