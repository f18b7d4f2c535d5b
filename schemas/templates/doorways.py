"""Wishes about doors, in template bodies of version 2."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from ..wire.base import Model
from .targets import DoorwayTarget, NameText


def _percent(value: Any) -> Any:
    """One line of advice for whatever is neither."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 100
    if not number and value != "Random":
        raise PydanticCustomError("no_percentage", 'a number from 0 to 100, or "Random", would be right')
    return float(value) if number else value


OpenPercent = Annotated[
    Annotated[float, Field(ge=0, le=100)] | Literal["Random"],
    BeforeValidator(_percent),
]


class DoorOpenPosition(Model):
    """How far a door is open at first."""

    Percent: OpenPercent = Field(default=100.0, description="0: closed, 100: fully open; Random: anything between.")


class DoorInitialState(Model):
    """A door when the simulation begins."""

    OpenPosition: DoorOpenPosition = Field(default=DoorOpenPosition(), description="How far it is open.")


class InteriorDoor(Model):
    """A door."""

    InitialState: DoorInitialState = Field(default=DoorInitialState(), description="How it is at first.")


class InteriorDoorwaySet(Model):
    """The doors of some doorways."""

    Name: NameText = Field(description="The set's name.")
    TargetSet: DoorwayTarget = Field(description="The doorways it is for.")
    Door: InteriorDoor = Field(default=InteriorDoor(), description="The doors they get.")


class TemplateDoorways(Model):
    """Doors."""

    DoorwaySets: list[InteriorDoorwaySet] = Field(
        default=[], max_length=13, description="Doors by doorway; other doorways get a door of any look, fully open."
    )
