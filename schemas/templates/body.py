"""Body of a world template, versions 1 and 2: a user's wishes for a world.

Names, defaults and limits of the members are those of the published schema. `parsing` reads bodies, and has the rules
that the schema does not contain.

The models are those of version 2, which includes version 1; a rule rejects newer members in bodies of version 1.
Version 2 adds doors, `Target.All` and `OriginalName`, and its default room has another name.
"""

import json
import re
from difflib import get_close_matches
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from ..wire.base import Model, optional
from ..wire.common import NO_CONTROLS
from ..wire.json_values import is_list, is_object
from ..worlds.world import FLOOR_MATERIALS, MODEL_TYPES, ROOM_TYPES, WALL_MATERIALS, FurnishedRoomType, PassageKind

OBJECT_TAG, CONSTANT_TAG = "\0object", "\0constant"
"""Tags that pydantic adds to the locations of errors; error messages leave them out."""

MOST_ROOMS = 12
"""Maximum number of rooms of a template: twice that of AWS; the search for plans of 12 rooms takes seconds."""

MOST_BALCONIES = 2
"""Maximum number of balconies of a template: flats have one or two."""

MOST_CONNECTIONS = 24
"""Maximum number of connections in a template, two per room; a room can have four."""

NameText = Annotated[str, Field(min_length=1, max_length=255, pattern=r"^[a-zA-Z0-9_\- ]*$")]


def _form(value: Any) -> str:
    return CONSTANT_TAG if isinstance(value, str) else OBJECT_TAG


All = Annotated[Literal["Target.All"], Tag(CONSTANT_TAG)]


class TemplateTargetSet(Model):
    """The rooms that a set of a world template applies to, by name or by type. A name has precedence over a type."""

    RoomNames: list[str] | None = Field(
        default=None, min_length=1, max_length=MOST_ROOMS, description="Names of rooms."
    )
    RoomTypes: list[FurnishedRoomType] | None = Field(
        default=None, min_length=1, max_length=len(ROOM_TYPES), description="Types of rooms."
    )


class RoomPairTargetFilter(Model):
    """The doorways that a set of a world template applies to: those between a room of one list and one of another."""

    From: TemplateTargetSet = Field(description="Rooms on one side.")
    To: TemplateTargetSet = Field(description="Rooms on the other side.")


RoomTarget = Annotated[Annotated[TemplateTargetSet, Tag(OBJECT_TAG)] | All, Discriminator(_form)]
"""Some rooms, or, in version 2, all rooms."""

DoorwayTarget = Annotated[Annotated[RoomPairTargetFilter, Tag(OBJECT_TAG)] | All, Discriminator(_form)]
"""Doorways between some rooms, or all doorways."""


def _percent(value: Any) -> Any:
    """Returns a percentage as a number, or the word `Random` as it is.

    Raises a validation error for anything else.
    """
    number = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 100
    if not number and value != "Random":
        raise PydanticCustomError("no_percentage", 'a number from 0 to 100, or "Random", would be right')
    return float(value) if number else value


OpenPercent = Annotated[
    Annotated[float, Field(ge=0, le=100)] | Literal["Random"],
    BeforeValidator(_percent),
]


class DoorOpenPosition(Model):
    """Opening of a door when the simulation begins, in percent."""

    Percent: OpenPercent = Field(default=100.0, description="0: closed, 100: fully open; Random: anything between.")


class DoorInitialState(Model):
    """Initial state of a door in a world template: how far it is open."""

    OpenPosition: DoorOpenPosition = Field(default=DoorOpenPosition(), description="How far it is open.")


class InteriorDoor(Model):
    """A door in the doorways of a world template."""

    InitialState: DoorInitialState = Field(default=DoorInitialState(), description="How it is at first.")


class InteriorDoorwaySet(Model):
    """Doors that a world template asks for in some of its doorways."""

    Name: NameText = Field(description="The set's name.")
    TargetSet: DoorwayTarget = Field(description="The doorways it is for.")
    Door: InteriorDoor = Field(default=InteriorDoor(), description="The doors they get.")


class TemplateDoorways(Model):
    """All doors that a world template asks for."""

    DoorwaySets: list[InteriorDoorwaySet] = Field(
        default=[], max_length=13, description="Doors by doorway; other doorways get a door of any look, fully open."
    )


FLOORPLAN_PATH = "Buildings[0].Floors[0].Floorplan"
"""JSON path of the floor plan in a body."""

INTERIOR_PATH = "Buildings[0].Floors[0].Interior"
"""JSON path of the interior in a body."""

SERVICE_LEAST_AREA_M2 = 10.0
"""Smallest area in m² that AWS allowed for a room; smaller rooms are an extension."""

LEAST_AREAS_M2: dict[FurnishedRoomType, float] = {
    "Balcony": 2.0,
    "Bathroom": 3.0,
    "Bedroom": 5.0,
    "Closet": 2.0,
    "Dining": 5.0,
    "Hallway": 2.0,
    "Kitchen": 4.0,
    "Living": 5.0,
    "Office": 4.0,
    "Storage": 2.0,
}
"""Smallest area in m² of a room by type: the square of its least width, or space for a door of 0.9 m and a turning
robot.
"""

SpatialDensity = Literal["Sparse", "Moderate", "Dense"]
Side = Annotated[float, Field(ge=1, le=4)]


def _one_of(what: str, values: tuple[str, ...]) -> AfterValidator:
    """Makes a validator that accepts only `values`, and whose error suggests the nearest one."""

    def check(value: str) -> str:
        if value in values:
            return value
        advice = nearest_of(value, values) or f"one of {', '.join(values)} would be right"
        raise PydanticCustomError("unknown_value", "not a {what}; {advice}", {"what": what, "advice": advice})

    return AfterValidator(check)


def nearest_of(value: str, values: tuple[str, ...]) -> str:
    """Returns `did you mean "X"?` for a misspelt value; empty if no allowed value is similar."""
    plain = {re.sub(r"[^a-z]", "", known.lower()): known for known in values}
    near = get_close_matches(re.sub(r"[^a-z]", "", value.lower()), plain, n=1)
    return f'did you mean "{plain[near[0]]}"?' if near else ""


FloorMaterial = Annotated[
    str, _one_of("floor material", FLOOR_MATERIALS), Field(json_schema_extra={"enum": [*FLOOR_MATERIALS]})
]
WallMaterial = Annotated[
    str, _one_of("wall material", WALL_MATERIALS), Field(json_schema_extra={"enum": [*WALL_MATERIALS]})
]
ModelType = Annotated[str, _one_of("model type", MODEL_TYPES), Field(json_schema_extra={"enum": [*MODEL_TYPES]})]


class TemplateAspectRatio(Model):
    """Aspect ratio of a room in a world template, as two lengths of which only the quotient counts."""

    x: Side = Field(default=1.0, description="Share of the side along x.")
    y: Side = Field(default=1.0, description="Share of the side along y.")


class TemplateShape(Model):
    """Size and aspect ratio that a world template wishes for a room."""

    Area: float = Field(
        ge=min(LEAST_AREAS_M2.values()),
        le=300,
        description="Desired area in square metres; below 10 m2 it is an extension of the service's format.",
    )
    AspectRatio: TemplateAspectRatio = Field(description="Desired ratio of the sides; the room may be turned.")


class TemplateRoom(Model):
    """A room that a world template asks for: its type, name and shape."""

    Type: FurnishedRoomType = Field(description="Steers neighbours, materials and furniture, not the shape.")
    Name: NameText = Field(description="The room's name, unique in the template.")
    OriginalName: Annotated[str, NO_CONTROLS] | None = optional(
        "Name that the user gave the room, in any letters; only in version 2."
    )
    DesiredShape: TemplateShape = Field(
        default=TemplateShape(Area=20.0, AspectRatio=TemplateAspectRatio()),
        description="Desired area and aspect ratio.",
    )


class DesiredConnection(Model):
    """A door or opening that a world template asks for between two rooms."""

    Location: list[str] = Field(min_length=2, max_length=2, description="Names of the two rooms.")
    ConnectionType: PassageKind = Field(description="Doorway: a gap in the wall; Opening: no wall.")

    @property
    def pair(self) -> frozenset[str]:
        """Names of the two connected rooms, in no order."""
        return frozenset(self.Location)


class TemplateFootprint(Model):
    """Outline of the building that a world template asks for."""

    DesiredAspectRatio: TemplateAspectRatio = Field(
        default=TemplateAspectRatio(), description="Desired extent along x over extent along y."
    )


class TemplateCeiling(Model):
    """Ceiling height that a world template asks for."""

    Height: float = Field(default=3.0, ge=2.4, le=4.0, description="Floor to ceiling in metres; guaranteed.")


class TemplateFloorplan(Model):
    """Rooms of a world template and the connections between them."""

    Footprint: TemplateFootprint = Field(default=TemplateFootprint(), description="The building's outline.")
    Ceiling: TemplateCeiling = Field(default=TemplateCeiling(), description="The ceiling.")
    Rooms: list[TemplateRoom] = Field(
        default=[TemplateRoom(Type="Living", Name="My Living Room")],
        min_length=1,
        max_length=MOST_ROOMS,
        description="The rooms; more than 6 are an extension of the service's format.",
    )
    DesiredConnections: list[DesiredConnection] = Field(
        default=[],
        max_length=MOST_CONNECTIONS,
        description="Ways between rooms; more are added until every room is connected.",
    )


class FloorSampleSet(Model):
    """Floor materials of a world template, of which the generator chooses one."""

    MaterialTypes: list[FloorMaterial] = Field(min_length=1, description="Floor materials to choose from.")


class WallSampleSet(Model):
    """Wall materials of a world template, of which the generator chooses one."""

    MaterialTypes: list[WallMaterial] = Field(min_length=1, description="Wall materials to choose from.")


class FurnitureSampleSet(Model):
    """Furniture types of a world template, of which the generator chooses."""

    ModelTypes: list[ModelType] = Field(description="Kinds of furniture; none leaves the rooms unfurnished.")


class FloorMaterialSet(Model):
    """Floor materials that a world template gives some rooms."""

    Name: NameText = Field(description="The set's name.")
    TargetSet: RoomTarget = Field(description="The rooms it is for.")
    SampleSet: FloorSampleSet | None = optional("Materials; absent: by room type.")


class WallMaterialSet(Model):
    """Wall materials that a world template gives some rooms."""

    Name: NameText = Field(description="The set's name.")
    TargetSet: RoomTarget = Field(description="The rooms it is for.")
    SampleSet: WallSampleSet | None = optional("Materials; absent: by room type.")


class FurnitureArrangement(Model):
    """Furniture that a world template gives some rooms."""

    Name: NameText = Field(description="The arrangement's name.")
    TargetSet: RoomTarget = Field(description="The rooms it is for.")
    SampleSet: FurnitureSampleSet | None = optional("Kinds; absent: by room type.")
    DesiredSpatialDensity: SpatialDensity = Field(default="Moderate", description="How full the rooms should be.")
    LooseObjects: int | None = Field(
        default=None,
        ge=0,
        le=40,
        description="Small things in each room that a robot can grasp or push, as many as fit; absent: a few. An "
        "extension of the service's format.",
    )


class TemplateFlooring(Model):
    """All floor materials that a world template asks for."""

    MaterialSets: list[FloorMaterialSet] = Field(
        default=[], max_length=MOST_ROOMS, description="Floor materials by room."
    )


class TemplateWalls(Model):
    """All wall materials that a world template asks for."""

    MaterialSets: list[WallMaterialSet] = Field(
        default=[], max_length=MOST_ROOMS, description="Wall materials by room."
    )


class TemplateFurniture(Model):
    """All furniture that a world template asks for."""

    FurnitureArrangements: list[FurnitureArrangement] = Field(
        default=[], max_length=MOST_ROOMS, description="Furniture by room; other rooms are furnished at random."
    )


class TemplateInterior(Model):
    """Floor materials, wall materials and furniture that a world template asks for."""

    Doorways: TemplateDoorways | None = optional("Doors; only in version 2.")
    Flooring: TemplateFlooring = Field(default=TemplateFlooring(), description="Floor materials.")
    Walls: TemplateWalls = Field(default=TemplateWalls(), description="Wall materials.")
    Furniture: TemplateFurniture = Field(default=TemplateFurniture(), description="Furniture.")


class TemplateFloor(Model):
    """One storey of a world template's building."""

    Floorplan: TemplateFloorplan = Field(default=TemplateFloorplan(), description="Rooms and ways between them.")
    Interior: TemplateInterior = Field(default=TemplateInterior(), description="Materials and furniture.")


class TemplateBuilding(Model):
    """The building that a world template describes."""

    Floors: list[TemplateFloor] = Field(
        default=[TemplateFloor()], min_length=1, max_length=1, description="Exactly one storey."
    )


_ROOMS: tuple[str | int, ...] = ("Buildings", 0, "Floors", 0, "Floorplan", "Rooms")
_ROOM_OF_VERSION_2 = {"Type": "Living", "Name": "My_Living_Room", "OriginalName": "My Living Room"}


def _with_default(value: Any, path: tuple[str | int, ...], default: Any) -> Any:
    """Returns a copy of a JSON value with a default at a path that has no value; other forms are unchanged."""
    if not path:
        return value
    key, rest = path[0], path[1:]
    if isinstance(key, int):
        return [_with_default(value[0], rest, default), *value[1:]] if is_list(value) and value else value
    if not is_object(value):
        return value
    if not rest:
        return {key: default, **value}
    return {**value, key: _with_default(value.get(key, [{}] if isinstance(rest[0], int) else {}), rest, default)}


class WorldTemplateBody(Model):
    """Body of a world template, from which worlds are generated; `{}` means one default room, in version 1."""

    Version: Literal["1", "2"] = Field(
        default="1", description="Version of the body's form; worlds of version 2 have doors."
    )
    Buildings: list[TemplateBuilding] = Field(
        default=[TemplateBuilding()], min_length=1, max_length=1, description="Exactly one building."
    )

    @model_validator(mode="before")
    @classmethod
    def _default_room(cls, document: Any) -> Any:
        """Validator that adds the default room of version 2 to a body without rooms."""
        second = is_object(document) and document.get("Version") == "2"
        return _with_default(document, _ROOMS, [_ROOM_OF_VERSION_2]) if second else document

    @property
    def floorplan(self) -> TemplateFloorplan:
        """The template's only floor plan: rooms and connections."""
        return self.Buildings[0].Floors[0].Floorplan

    @property
    def interior(self) -> TemplateInterior:
        """The template's only interior: materials and furniture."""
        return self.Buildings[0].Floors[0].Interior

    def canonical(self) -> str:
        """Returns the body as compact JSON with defaults and sorted keys: equal templates give equal text."""
        return json.dumps(self.model_dump(exclude_none=True), sort_keys=True, separators=(",", ":"))
