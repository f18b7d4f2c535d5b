"""Base of all parts of a stored rollout: they are frozen, and are stored without members that are absent."""

from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field
from pydantic.alias_generators import to_camel

MAX_ACTION_ID = 2**31 - 1
"""Largest number of an order: what clients of hawkBit hold as a signed integer of 32 bits."""

ActionId = Annotated[int, Field(ge=1, le=MAX_ACTION_ID)]
"""The number of one order to one robot, unlike that of any other order of the catalog."""

TimeS = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
"""A moment, in seconds since the epoch."""


class StoredPart(BaseModel):
    """A frozen object, stored under camelCase names; members that newer releases added are left alone.

    `documents.base.Part` is the same for small documents: it makes its JSON in Python, which takes five times as long,
    and the rollout of a large fleet is written again and again.
    """

    model_config = ConfigDict(
        alias_generator=to_camel,
        validate_by_name=True,
        validate_by_alias=True,
        frozen=True,
        extra="ignore",
        defer_build=True,
    )

    def to_json(self) -> dict[str, Any]:
        """The object as plain JSON values, without members that are absent."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    @classmethod
    def of_json(cls, stored: dict[str, Any]) -> Self:
        """Reads what `to_json` made."""
        return cls.model_validate(stored)
