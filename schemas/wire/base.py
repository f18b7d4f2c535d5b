"""Base classes of all models: strict types, no unknown members, immutable."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field

STORED: Mapping[str, bool] = {"stored": True}
"""Validation context for stored requests, and for responses that contain them. An older release has accepted them, so
rules about combinations of members, which may be newer, are not applied.
"""


def optional(description: str) -> Any:
    """Declares a member of a pydantic model that may be absent, and is `None` then."""
    return Field(default=None, description=description)


class Model(BaseModel):
    """Base class of immutable pydantic models: unknown members and wrong types are errors, nothing is converted."""

    # Validators are built when first used: building all was a third of the time to import what `validate` needs
    # (0.57 of CPU seconds, now 0.38), and a process uses few of them.
    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, use_attribute_docstrings=False, defer_build=True
    )


class Shape(Model):
    """Base class of the structures in the service's requests and responses.

    Attributes have the service's member names unchanged, so that request bodies, keyword arguments of SDK calls and
    parameters of flows have the same names. A member that is `None` is absent, and is left out of the message.
    """

    def to_wire(self) -> dict[str, Any]:
        """Returns the members that are present as plain values, for a message (`datetime` stays `datetime`)."""
        return self.model_dump(exclude_none=True)


@dataclass(frozen=True)
class ShapeName:
    """Type annotation (with `Annotated`) that gives the service's name of a simple shape, list or map.

    Bounds are given where the service publishes some that are not enforced here: those of lists in responses.
    """

    name: str
    minimum: int | None = None
    maximum: int | None = None
    wire_type: Literal["long"] | None = None
    """Type in the API, if Python has no such type: a 64-bit integer (`long`)."""


@dataclass(frozen=True)
class NamesWorld:
    """Type annotation (with `Annotated`) of the ARN of a world; a specification may name the world instead."""


def choices(enumeration: Any) -> tuple[Any, ...]:
    """Returns the values of a `Literal` type, also inside `Annotated`."""
    if get_origin(enumeration) is Annotated:
        enumeration = get_args(enumeration)[0]
    return get_args(enumeration)
