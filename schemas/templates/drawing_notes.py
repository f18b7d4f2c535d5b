"""Notes file of a floor plan drawing: YAML with the facts that the drawing does not show.

```yaml
scale: 0.01
ceilingHeight: 2.5
rooms:
  Arbeitszimmer: {type: Bedroom}
interior:
  Furniture:
    FurnitureArrangements:
      - {Name: dense, TargetSet: {RoomTypes: [Living]}, DesiredSpatialDensity: Dense}
```
"""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from ..wire.base import Model, optional
from ..worlds.world import FurnishedRoomType
from .body import TemplateInterior


def _scale(value: str | float) -> str | float:
    ratio = isinstance(value, str) and re.fullmatch(r"1\s*:\s*[1-9]\d*(\.\d+)?", value)
    if not ratio and (isinstance(value, str) or value <= 0):
        raise PydanticCustomError(
            "no_scale", 'metres a unit, such as 0.01, or a scale on paper, "1:50", would be right'
        )
    return value


Scale = Annotated[str | float, AfterValidator(_scale)]


class RoomNotes(Model):
    """Facts about a room which a floor plan drawing does not show, such as its type."""

    type: FurnishedRoomType = Field(description="Its type, which steers materials and furniture.")


class DrawingNotes(Model):
    """Facts which a floor plan drawing does not show, such as its scale and its rooms' types."""

    scale: Scale | None = optional(
        "Metres of the world for one unit of the drawing, or a scale on paper such as `1:50`."
    )
    outlines: Literal["faces", "centres"] | None = optional(
        "Meaning of the outlines of rooms: the inner faces of their walls, or the walls' middles; absent: "
        "faces where there are gaps between rooms."
    )
    ceilingHeight: float = Field(default=2.5, ge=2.4, le=4.0, description="Floor to ceiling in metres.")
    rooms: dict[str, RoomNotes] = Field(default={}, description="Types of rooms by their names in the drawing.")
    interior: TemplateInterior = Field(
        default=TemplateInterior(),
        description="Materials, furniture and doors, as in the `Interior` of a world template.",
    )
