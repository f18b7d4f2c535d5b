"""Description and checks of a world for other programs: the content of `world_description.json`.

DescribeWorld responds with the same members and `contentHash` as `worldDescriptionBody`, and an export has the file
next to each world. AWS never published its schema; this one is the project's own. Lengths are metres, angles radians,
areas square metres; x points east, y north, z up, and the floor's surface is z = 0.
"""

from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional
from .world import PassageKind, Point, Preference, RoomType, Source, Variation, WorldChecks

DESCRIPTION_FILE = "world_description.json"
"""Name of the file in a world bundle and in an export."""


class Units(Model):
    """Units of all numbers in a world description."""

    length: Literal["metre"] = Field(default="metre", description="Unit of positions and extents.")
    angle: Literal["radian"] = Field(default="radian", description="Unit of yaws and openings.")
    area: Literal["square metre"] = Field(default="square metre", description="Unit of the areas of floors.")


class Position(Model):
    """Position in a world, in metres."""

    x: float = Field(description="East.")
    y: float = Field(description="North.")
    z: float = Field(default=0.0, description="Up, from the floor.")


class Pose(Position):
    """Position (metres) and direction in a world."""

    yaw: float = Field(description="Turn about z, counter-clockwise from x.")


class Size(Model):
    """Dimensions of an object in its own frame, in metres."""

    width: float = Field(description="Across the direction it faces.")
    depth: float = Field(description="Along the direction it faces.")
    height: float = Field(description="Upwards.")


class DescribedRoom(Model):
    """A room in a world description."""

    name: str = Field(description="Its name in the template.")
    originalName: str | None = optional("Its `OriginalName` in the template, if it has one.")
    type: RoomType = Field(description="Its type in the template.")
    area: float = Field(description="Inside the centre lines of its walls.")
    polygon: list[Point] = Field(description="Its corners, counter-clockwise, on the centre lines of its walls.")
    goal: Position = Field(description="A free spot in it that a robot can reach.")
    floorMaterial: str = Field(description="Material of its floor.")
    wallMaterial: str = Field(description="Material of its walls.")


class DescribedPassage(Model):
    """An opening or doorway between two rooms in a world description."""

    type: PassageKind = Field(description="Doorway: a gap in a wall; Opening: the wall is gone.")
    rooms: tuple[str, str] = Field(description="Names of the two rooms.")
    start: Point = Field(description="One side, on the wall's centre line.")
    end: Point = Field(description="The other side.")
    width: float = Field(description="Between its sides.")
    door: str | None = optional("Name of its door, if it has one.")


class Opening(Model):
    """Opening of a door when the simulation begins, as an angle and in percent."""

    percent: float = Field(description="0: closed, 100: as far as it goes.")
    angle: float = Field(description="The same as the joint's position.")


class DescribedDoor(Model):
    """A hinged door in a world description."""

    name: str = Field(description="Name of its body and of its joint.")
    rooms: tuple[str, str] = Field(description="Names of the two rooms it parts.")
    opensInto: str = Field(description="Name of the room its leaf swings into.")
    hinge: Pose = Field(description="Foot of the hinge's axis, and direction from there along the closed leaf.")
    axis: tuple[float, float, float] = Field(description="The joint's axis: turning about it opens the door.")
    maxAngle: float = Field(description="The furthest it opens; 0 is closed.")
    size: Size = Field(description="The leaf: from the hinge to its free edge, its thickness, its height.")
    clearWidth: float = Field(description="Clear width of the doorway with the leaf fully open.")
    initialOpening: Opening = Field(description="How far it is open at first.")
    style: str = Field(description="Parametric style of the door.")


class DescribedFurniture(Model):
    """A piece of furniture or a loose object in a world description."""

    name: str = Field(description="Unique in the world; of a loose object, the name of its body.")
    modelType: str = Field(description="Model type, or the kind of a loose object.")
    style: str = Field(description="Parametric style of that type.")
    room: str = Field(description="Name of the room it stands in.")
    pose: Pose = Field(description="Middle of its lower side, and the direction its front faces.")
    size: Size = Field(description="Its extents.")
    movable: bool = Field(description="Whether it is a free body.")


class Seeds(Model):
    """Random seeds that a world was generated from."""

    floorplan: int = Field(description="Seed of the floor plan.")
    interior: int = Field(description="Seed of the interior.")


class Proofs(Model):
    """Measurements of a world's checks, and whether it meets the guarantees of every world."""

    guaranteesHold: bool = Field(description="Whether none of the guarantees is broken.")
    violations: list[str] = Field(description="The guarantees that are broken, one sentence each.")
    checks: WorldChecks = Field(description="The measurements: the `checks` of `world.json`.")
    wishes: list[Preference] = Field(description="Outcome of each preference of the template, with the reason.")


class WorldDescription(Model):
    """Description of a whole world (rooms, doors, furniture) as JSON for other programs."""

    version: Literal["1"] = Field(default="1", description="Version of this document's form.")
    templateVersion: Literal["1", "2"] = Field(description="Version of the template's body.")
    generatorVersion: str = Field(description="Version of the generator that made the world.")
    contentHash: str | None = optional("SHA-256 of the world's bundle; only in what DescribeWorld answers.")
    seeds: Seeds | None = optional("Seeds that give the same world again.")
    units: Units = Field(default=Units(), description="Units of all numbers.")
    ceilingHeight: float = Field(description="Floor to ceiling.")
    footprint: list[Point] = Field(
        description="Corners of the building with its balconies, counter-clockwise, on centre lines of walls."
    )
    plan: str | None = optional(
        "Key of the plan: the same for worlds whose rooms touch on the same sides, have the same doors and an outline "
        "with as many corners, however they are turned and mirrored; absent before generator 3.3.0."
    )
    rooms: list[DescribedRoom] = Field(description="The rooms, in the template's order.")
    passages: list[DescribedPassage] = Field(description="The ways between rooms.")
    doors: list[DescribedDoor] = Field(description="The doors.")
    furniture: list[DescribedFurniture] = Field(description="Furniture and loose objects.")
    source: Source | None = optional("Drawing, map or world file that it was imported from; absent: it was generated.")
    variation: Variation | None = optional(
        "Differences from the world it was made of; absent in worlds made by themselves."
    )
    proofs: Proofs | None = optional("Measurements of the world; absent if nothing was measured.")
