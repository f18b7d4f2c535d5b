"""Target sets: the rooms and the doorways that the sets of a template body are for."""

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from ..wire.base import Model
from ..worlds.world import RoomType

OBJECT_TAG, CONSTANT_TAG = "\0object", "\0constant"
"""Pydantic puts these into the locations of errors; error messages leave them out."""

NameText = Annotated[str, Field(min_length=1, max_length=255, pattern=r"^[a-zA-Z0-9_\- ]*$")]


def _form(value: Any) -> str:
    return CONSTANT_TAG if isinstance(value, str) else OBJECT_TAG


All = Annotated[Literal["Target.All"], Tag(CONSTANT_TAG)]


class TemplateTargetSet(Model):
    """Rooms that a set is for: by name or by type. A name beats a type for the same room."""

    RoomNames: list[str] | None = Field(default=None, min_length=1, max_length=6, description="Names of rooms.")
    RoomTypes: list[RoomType] | None = Field(default=None, min_length=1, max_length=7, description="Types of rooms.")


class RoomPairTargetFilter(Model):
    """Doorways that a set is for: those between any room of one list and any room of another."""

    From: TemplateTargetSet = Field(description="Rooms on one side.")
    To: TemplateTargetSet = Field(description="Rooms on the other side.")


RoomTarget = Annotated[Annotated[TemplateTargetSet, Tag(OBJECT_TAG)] | All, Discriminator(_form)]
"""Some rooms, or, in version 2, all."""

DoorwayTarget = Annotated[Annotated[RoomPairTargetFilter, Tag(OBJECT_TAG)] | All, Discriminator(_form)]
"""The doorways between some rooms, or all."""
