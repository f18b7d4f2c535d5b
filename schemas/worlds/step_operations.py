"""Operations that only steps of specifications can use; they are not part of the service's API.

```yaml
variations:
  operation: VaryWorlds
  input:
    worlds: ${{ worlds.finishedWorldsSummary.succeededWorlds }}
    variations:
      - {light: night}
      - {shut: [Hall/Bathroom], remove: [Sofas_1]}
```
"""

from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from ..wire.base import Shape, optional
from ..wire.common import Arn, WorldArn
from ..wire.operation_shape import INTERNAL, INVALID, NOT_FOUND, OperationShape
from .world import Light


def _finite(numbers: list[float]) -> list[float]:
    if not all(map(isfinite, numbers)):
        raise ValueError("metres to the east and north, and degrees, have to be finite numbers")
    return numbers


MOST_VARIATIONS = 1000
"""Maximum number of worlds that one step makes: worlds times variations."""

Percent = Annotated[float, Field(ge=0, le=100)]
Friction = Annotated[float, Field(ge=0, le=10)]
MoveBy = Annotated[list[float], Field(min_length=2, max_length=3), AfterValidator(_finite)]


class WorldVariation(Shape):
    """Changes that a variation applies to an existing world, such as light, doors and furniture."""

    shut: list[str] = Field(default=[], description="Doors to shut: ids, or the rooms of each, `Hall/Bathroom`.")
    open: dict[str, Percent] = Field(default={}, description="How far doors are to be open, in percent.")
    move: dict[str, MoveBy] = Field(
        default={},
        description="Pieces of furniture to move: metres to the east and north and, if wanted, degrees "
        "counter-clockwise. What stands on a piece goes with it.",
    )
    remove: list[str] = Field(default=[], description="Pieces to take away, with what stands on them.")
    light: Light | None = optional("How cameras see it; absent: as they see the world itself.")
    friction: dict[str, Friction] = Field(
        default={},
        description="Sliding friction of pieces of worlds that were imported from Gazebo, 0 to 10; `*` is all of them.",
    )

    @model_validator(mode="after")
    def _says_something_once(self) -> Self:
        if not (self.shut or self.open or self.move or self.remove or self.light or self.friction):
            raise ValueError("nothing would differ; say one of shut, open, move, remove, light or friction")
        if both := sorted({*self.shut} & self.open.keys()):
            raise ValueError(f"{both[0]!r} is to be shut and to be open; leave it out of one of them")
        return self


class VaryWorldsRequest(Shape):
    """Request of the pipeline operation `VaryWorlds`: makes variations of existing worlds."""

    worlds: list[WorldArn] = Field(min_length=1, max_length=1000, description="ARNs of the worlds, 1 to 1000.")
    variations: list[WorldVariation] = Field(
        min_length=1, max_length=100, description="Variations to make, 1 to 100; each world gets all of them."
    )

    @model_validator(mode="after")
    def _not_too_many(self) -> Self:
        if (count := len(self.worlds) * len(self.variations)) > MOST_VARIATIONS:
            raise ValueError(f"{count} worlds would be made; at most {MOST_VARIATIONS} in a step would be right")
        return self


class VariedWorld(Shape):
    """A variation of a world, as the response of `VaryWorlds` reports it."""

    arn: Arn = Field(description="ARN of the variation.")
    world: Arn = Field(description="ARN of the world it was made of.")
    changes: list[str] = Field(description="Each difference, in words.")
    brokenGuarantees: list[str] = Field(description="Guarantees that it breaks, in words; empty: all hold.")


class VaryWorldsResponse(Shape):
    """Response of the pipeline operation `VaryWorlds`: the variations that were made."""

    worlds: list[Arn] = Field(description="ARNs of the variations: those of the first world, then of the second, ….")
    variedWorlds: list[VariedWorld] = Field(description="The same, with what differs and what was proven.")


STEP_OPERATIONS: Mapping[str, OperationShape] = {
    shape.name: shape
    for shape in (
        OperationShape(
            VaryWorldsRequest,
            (INVALID, NOT_FOUND, INTERNAL),
            "Makes worlds that differ from others in what is said, for tests of robustness.",
        ),
    )
}
"""Step operations by name."""
