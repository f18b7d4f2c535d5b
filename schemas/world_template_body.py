"""The body of a world template, versions 1 and 2: what a user wishes a world to be.

`parse_template_body` turns JSON text into a `WorldTemplateBody` or says, one line per problem, where
the text is wrong and what would be right. The members' names, defaults and limits are those of the
published schema; the rules that the schema leaves to prose (areas, names that must exist, connections
that contradict each other, materials) are enforced here as well.

The models are those of version 2, which has all that version 1 has; what version 1 lacks is refused in its
bodies by a rule. Version 2 adds doors, `Target.All` and `OriginalName`, and its default room has another name.
"""

import json
import re
from collections.abc import Iterator
from difflib import get_close_matches
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from .base import Model
from .errors import InvalidParameterException
from .request_problems import misspelt_members, pattern_in_words
from .strict_json import load_strict, show
from .world import FLOOR_MATERIALS, MODEL_TYPES, WALL_MATERIALS, PassageKind, RoomType
from .world_template_doorways import TemplateDoorways
from .world_template_rules import FLOORPLAN_PATH as FLOORPLAN_PATH
from .world_template_rules import INTERIOR_PATH as INTERIOR_PATH
from .world_template_rules import rule_problems
from .world_template_targets import CONSTANT_TAG, OBJECT_TAG, NameText, RoomTarget
from .world_template_targets import TemplateTargetSet as TemplateTargetSet

MAX_BODY_CHARACTERS = 262_144
_MAX_REPORTED_PROBLEMS = 20

SpatialDensity = Literal["Sparse", "Moderate", "Dense"]
Side = Annotated[float, Field(ge=1, le=4)]


def _one_of(what: str, values: tuple[str, ...]) -> AfterValidator:
    """Lets only `values` pass and suggests the nearest one."""

    def check(value: str) -> str:
        if value in values:
            return value
        advice = _suggestion(value, values) or f"one of {', '.join(values)} would be right"
        raise PydanticCustomError("unknown_value", "not a {what}; {advice}", {"what": what, "advice": advice})

    return AfterValidator(check)


def _suggestion(value: str, values: tuple[str, ...]) -> str:
    """`did you mean "X"?`, or nothing when no value comes near."""
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
    """A ratio of two sides; only the quotient counts."""

    x: Side = Field(default=1.0, description="Share of the side along x.")
    y: Side = Field(default=1.0, description="Share of the side along y.")


class TemplateShape(Model):
    """How large a room should be, and how long for its width."""

    Area: float = Field(ge=10, le=300, description="Desired area in square metres.")
    AspectRatio: TemplateAspectRatio = Field(description="Desired ratio of the sides; the room may be turned.")


class TemplateRoom(Model):
    """One wished room."""

    Type: RoomType = Field(description="Steers neighbours, materials and furniture, not the shape.")
    Name: NameText = Field(description="The room's name, unique in the template.")
    OriginalName: str | None = Field(
        default=None, description="What the user called the room, in any letters; only in version 2."
    )
    DesiredShape: TemplateShape = Field(
        default=TemplateShape(Area=20.0, AspectRatio=TemplateAspectRatio()),
        description="Desired area and aspect ratio.",
    )


class DesiredConnection(Model):
    """A wished way between two rooms."""

    Location: list[str] = Field(min_length=2, max_length=2, description="Names of the two rooms.")
    ConnectionType: PassageKind = Field(description="Doorway: a gap in the wall; Opening: no wall.")

    @property
    def pair(self) -> frozenset[str]:
        """The two rooms, in no order."""
        return frozenset(self.Location)


class TemplateFootprint(Model):
    """The building's outline."""

    DesiredAspectRatio: TemplateAspectRatio = Field(
        default=TemplateAspectRatio(), description="Desired extent along x over extent along y."
    )


class TemplateCeiling(Model):
    """The ceiling."""

    Height: float = Field(default=3.0, ge=2.4, le=4.0, description="Floor to ceiling in metres; guaranteed.")


class TemplateFloorplan(Model):
    """Wishes about rooms and the ways between them."""

    Footprint: TemplateFootprint = Field(default=TemplateFootprint(), description="The building's outline.")
    Ceiling: TemplateCeiling = Field(default=TemplateCeiling(), description="The ceiling.")
    Rooms: list[TemplateRoom] = Field(
        default=[TemplateRoom(Type="Living", Name="My Living Room")],
        min_length=1,
        max_length=6,
        description="The rooms.",
    )
    DesiredConnections: list[DesiredConnection] = Field(
        default=[], max_length=12, description="Ways between rooms; more are added until every room is connected."
    )


class FloorSampleSet(Model):
    """Floor materials to choose from."""

    MaterialTypes: list[FloorMaterial] = Field(min_length=1, description="Floor materials to choose from.")


class WallSampleSet(Model):
    """Wall materials to choose from."""

    MaterialTypes: list[WallMaterial] = Field(min_length=1, description="Wall materials to choose from.")


class FurnitureSampleSet(Model):
    """Kinds of furniture to choose from."""

    ModelTypes: list[ModelType] = Field(description="Kinds of furniture; none leaves the rooms unfurnished.")


class FloorMaterialSet(Model):
    """Floor materials of some rooms."""

    Name: NameText = Field(description="The set's name.")
    TargetSet: RoomTarget = Field(description="The rooms it is for.")
    SampleSet: FloorSampleSet | None = Field(default=None, description="Materials; absent: by room type.")


class WallMaterialSet(Model):
    """Wall materials of some rooms."""

    Name: NameText = Field(description="The set's name.")
    TargetSet: RoomTarget = Field(description="The rooms it is for.")
    SampleSet: WallSampleSet | None = Field(default=None, description="Materials; absent: by room type.")


class FurnitureArrangement(Model):
    """Furniture of some rooms."""

    Name: NameText = Field(description="The arrangement's name.")
    TargetSet: RoomTarget = Field(description="The rooms it is for.")
    SampleSet: FurnitureSampleSet | None = Field(default=None, description="Kinds; absent: by room type.")
    DesiredSpatialDensity: SpatialDensity = Field(default="Moderate", description="How full the rooms should be.")


class TemplateFlooring(Model):
    """Floor materials."""

    MaterialSets: list[FloorMaterialSet] = Field(default=[], max_length=6, description="Floor materials by room.")


class TemplateWalls(Model):
    """Wall materials."""

    MaterialSets: list[WallMaterialSet] = Field(default=[], max_length=6, description="Wall materials by room.")


class TemplateFurniture(Model):
    """Furniture."""

    FurnitureArrangements: list[FurnitureArrangement] = Field(
        default=[], max_length=6, description="Furniture by room; other rooms are furnished at random."
    )


class TemplateInterior(Model):
    """Wishes about materials and furniture."""

    Doorways: TemplateDoorways | None = Field(default=None, description="Doors; only in version 2.")
    Flooring: TemplateFlooring = Field(default=TemplateFlooring(), description="Floor materials.")
    Walls: TemplateWalls = Field(default=TemplateWalls(), description="Wall materials.")
    Furniture: TemplateFurniture = Field(default=TemplateFurniture(), description="Furniture.")


class TemplateFloor(Model):
    """One storey."""

    Floorplan: TemplateFloorplan = Field(default=TemplateFloorplan(), description="Rooms and ways between them.")
    Interior: TemplateInterior = Field(default=TemplateInterior(), description="Materials and furniture.")


class TemplateBuilding(Model):
    """One building."""

    Floors: list[TemplateFloor] = Field(
        default=[TemplateFloor()], min_length=1, max_length=1, description="Exactly one storey."
    )


_ROOMS: tuple[str | int, ...] = ("Buildings", 0, "Floors", 0, "Floorplan", "Rooms")
_ROOM_OF_VERSION_2 = {"Type": "Living", "Name": "My_Living_Room", "OriginalName": "My Living Room"}


def _with_default(value: Any, path: tuple[str | int, ...], default: Any) -> Any:
    """A copy of a JSON value with `default` at a path where nothing is; a value of another form is left as it is."""
    if not path:
        return value
    key, rest = path[0], path[1:]
    if isinstance(key, int):
        return [_with_default(value[0], rest, default), *value[1:]] if isinstance(value, list) and value else value
    if not isinstance(value, dict):
        return value
    if not rest:
        return {key: default, **value}
    return {**value, key: _with_default(value.get(key, [{}] if isinstance(rest[0], int) else {}), rest, default)}


class WorldTemplateBody(Model):
    """A whole template body; `{}` is one, of version 1, and means a single default room."""

    Version: Literal["1", "2"] = Field(
        default="1", description="Version of the body's form; worlds of version 2 have doors."
    )
    Buildings: list[TemplateBuilding] = Field(
        default=[TemplateBuilding()], min_length=1, max_length=1, description="Exactly one building."
    )

    @model_validator(mode="before")
    @classmethod
    def _default_room(cls, document: Any) -> Any:
        """The default room of version 2."""
        second = isinstance(document, dict) and document.get("Version") == "2"
        return _with_default(document, _ROOMS, [_ROOM_OF_VERSION_2]) if second else document

    @property
    def floorplan(self) -> TemplateFloorplan:
        """The wishes about the one floor plan there is."""
        return self.Buildings[0].Floors[0].Floorplan

    @property
    def interior(self) -> TemplateInterior:
        """The wishes about the one interior there is."""
        return self.Buildings[0].Floors[0].Interior

    def canonical(self) -> str:
        """The body as compact JSON with all defaults filled in and sorted keys: equal wishes, equal text."""
        return json.dumps(self.model_dump(exclude_none=True), sort_keys=True, separators=(",", ":"))


def parse_template_body(text: str) -> WorldTemplateBody:
    """Reads a template body.

    A body wrapped as `{"name": ..., "templateBody": {...}}`, as the official samples have it, is
    unwrapped.

    Args:
      text: JSON text of at most 262144 characters.

    Raises:
      InvalidParameterException: with one line per problem: JSON path, value, what would be right.
    """
    document, prefix = _unwrap(load_strict(text, "templateBody", MAX_BODY_CHARACTERS))
    problems = list(_version_problems(document)) or list(_null_problems(document))
    if not problems:
        try:
            body = WorldTemplateBody.model_validate(document)
        except ValidationError as error:
            found = [_untagged(each) for each in error.errors(include_url=False)]
            misspelt = misspelt_members(found)
            problems = [_explain(each) for each in found if each["type"] != "missing" or each["loc"] not in misspelt]
        else:
            problems = list(rule_problems(body))
            if not problems:
                return body
    more = len(problems) - _MAX_REPORTED_PROBLEMS
    lines = [prefix + problem for problem in problems[:_MAX_REPORTED_PROBLEMS]]
    raise InvalidParameterException("\n".join([*lines, f"... and {more} more problems"] if more > 0 else lines))


def unwrapped_text(text: str) -> str:
    """The body alone: the text itself, or, where that is a wrapped body, the JSON text of what it wraps.

    Args:
      text: a body that `parse_template_body` accepts.
    """
    document = json.loads(text)
    body, prefix = _unwrap(document)
    return json.dumps(body, ensure_ascii=False) if prefix else text


def _unwrap(document: Any) -> tuple[Any, str]:
    """The body itself, and what its paths start with in the text the user wrote."""
    if isinstance(document, dict) and "templateBody" in document and not document.keys() - {"name", "templateBody"}:
        return document["templateBody"], "templateBody."
    return document, ""


def _version_problems(document: Any) -> Iterator[str]:
    """Comes first: members of another version's bodies would only add noise."""
    if not isinstance(document, dict):
        yield f"body: {show(document)}: not a JSON object"
    elif document.get("Version", "1") not in ("1", "2"):
        yield f'Version: {show(document["Version"])}: no such version; "1" or "2", in quotes, would be right'


def _null_problems(value: Any, path: str = "") -> Iterator[str]:
    """The published schema knows no null: an absent member is left out."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _null_problems(item, _join(path, key))
    elif value is None:
        yield f"{path}: null: not allowed; leave it out instead"


def _join(path: str, key: str | int) -> str:
    if isinstance(key, int):
        return f"{path}[{key}]"
    # Member names that a user made up may hold anything; they stay on one printable line.
    name = key if key.isidentifier() and key.isascii() else show(key)
    return f"{path}.{name}" if path else name


def _untagged(detail: ErrorDetails) -> ErrorDetails:
    """The same error, located by what stands in the document alone."""
    detail["loc"] = tuple(key for key in detail["loc"] if key not in (OBJECT_TAG, CONSTANT_TAG))
    return detail


def _explain(detail: ErrorDetails) -> str:
    """One pydantic error as a line."""
    path = ""
    for key in detail["loc"]:
        path = _join(path, key)
    if detail["type"] == "missing":
        return f"{path}: missing; it is required"
    if detail["type"] == "extra_forbidden":
        known = _members_at(detail["loc"][:-1])
        advice = _suggestion(str(detail["loc"][-1]), known) or f"known here: {', '.join(known)}"
        return f"{path}: unknown member; {advice}"
    return f"{path}: {show(detail['input'])}: {_advice(detail)}"


_RIGHT = {
    "greater_than_equal": "{ge:g} or more",
    "less_than_equal": "{le:g} or less",
    "too_short": "{min_length} or more entries",
    "too_long": "at most {max_length} entries",
    "string_too_short": "{min_length} or more characters",
    "string_too_long": "at most {max_length} characters",
    "string_type": "text",
    "list_type": "a list",
    "model_type": "an object",
}


def _advice(detail: ErrorDetails) -> str:
    """What would be right in place of a value."""
    kind, context = detail["type"], dict(detail.get("ctx", {}))
    if kind == "literal_error" and isinstance(detail["input"], str):
        expected = tuple(re.findall("'([^']+)'", context["expected"]))
        if advice := _suggestion(detail["input"], expected):
            return advice
    if kind == "string_pattern_mismatch":
        return f"text {pattern_in_words(context['pattern'])} would be right"
    if kind == "float_type":
        return "a number without quotes would be right" if _is_number(detail["input"]) else "a number would be right"
    if kind in _RIGHT:
        return f"{_RIGHT[kind].format_map(context)} would be right"
    message = detail["msg"].removeprefix("Input should be ")
    return message if message == detail["msg"] else f"{message} would be right"


def _is_number(value: object) -> bool:
    return isinstance(value, str) and re.fullmatch(r"\d+(\.\d+)?", value) is not None


def _members_at(location: tuple[int | str, ...]) -> tuple[str, ...]:
    """Names of the members that the object at `location` may have."""
    model: Any = WorldTemplateBody
    for key in location:
        if isinstance(key, str):
            annotation = model.model_fields[key].annotation
            while arguments := [argument for argument in get_args(annotation) if argument is not type(None)]:
                annotation = arguments[0]
            model = annotation
    return tuple(model.model_fields)
