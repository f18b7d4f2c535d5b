"""Notes file of an imported Gazebo world: YAML with the facts that the world file does not contain.

```yaml
rooms:
  Kitchen: {type: Kitchen, polygon: [[0, 0], [4, 0], [4, 3], [0, 3]]}
goals:
  sofa: [1.5, 2.0]
```
"""

from math import isfinite
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from ..wire.base import Model
from .world import Point, RoomType

_LEAST_M2 = 0.01
"""Minimum area of a room in m²: four cells of a map."""
_LEVEL_M = 0.01
"""Height difference in metres along an edge up to which it counts as level or upright."""


def _pair(value: object) -> object:
    """Converts a YAML list of two numbers to a pair; returns anything else as it is."""
    if not isinstance(value, list):
        return value
    given: list[object] = value  # pyright: ignore[reportUnknownVariableType] - pydantic checks what is in it
    return tuple(float(each) if isinstance(each, int) else each for each in given)


def _finite(point: Point) -> Point:
    if not all(isfinite(each) for each in point):
        raise PydanticCustomError("endless", "finite numbers would be right")
    return point


Spot = Annotated[Point, BeforeValidator(_pair), AfterValidator(_finite)]
"""Position in the frame of the world file, in metres."""


def _upright(polygon: list[Point]) -> list[Point]:
    edges = list(zip(polygon, [*polygon[1:], polygon[0]], strict=True))
    if any(min(abs(x0 - x1), abs(y0 - y1)) > _LEVEL_M for (x0, y0), (x1, y1) in edges):
        raise PydanticCustomError("slanted", "a polygon with level and upright edges would be right")
    if abs(sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in edges)) / 2 < _LEAST_M2:
        raise PydanticCustomError("empty", "a polygon with an area would be right")
    return polygon


class NotedRoom(Model):
    """A room in the notes file of an imported Gazebo world: name and area."""

    type: RoomType = Field(default="Area", description="Its type.")
    polygon: Annotated[list[Spot], AfterValidator(_upright)] = Field(
        min_length=4,
        max_length=200,
        description="Its corners in the frame of the world file, metres; edges run along x and y.",
    )


class GazeboNotes(Model):
    """Facts that a Gazebo world file does not contain, such as its rooms."""

    rooms: dict[str, NotedRoom] = Field(
        default={}, max_length=200, description="Rooms by name; absent: the whole world is one area."
    )
    goals: dict[str, Spot] = Field(
        default={},
        max_length=200,
        description="Named goals in the frame of the world file, metres; a robot has to reach each.",
    )
