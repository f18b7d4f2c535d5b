"""Parser of world template bodies, with the rules that the schema does not contain.

`parse_template_body` converts JSON text to a `WorldTemplateBody`, or reports, one line per problem, where the text is
wrong and what would be right.
"""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from ..wire.errors import InvalidParameterException
from ..wire.json_values import is_list, is_object, load_strict, show
from ..wire.request_problems import RequestProblem, misspelt_members, pattern_in_words
from ..worlds.world import OUTDOOR_ROOM_TYPE
from .body import (
    CONSTANT_TAG,
    FLOORPLAN_PATH,
    INTERIOR_PATH,
    LEAST_AREAS_M2,
    MOST_BALCONIES,
    OBJECT_TAG,
    DesiredConnection,
    TemplateFloorplan,
    TemplateTargetSet,
    WorldTemplateBody,
    nearest_of,
)

MAX_CONNECTIONS_PER_ROOM = 4


def rule_problems(body: WorldTemplateBody) -> Iterator[str]:
    """Finds violations of the rules for world templates that the service's guide gives in prose."""
    if body.Version == "1":
        yield from _problems_of_version_1(body)
    names = tuple(room.Name for room in body.floorplan.Rooms)
    for index, name in enumerate(names):
        if name in names[:index]:
            path = f"{FLOORPLAN_PATH}.Rooms[{index}].Name"
            yield f"{path}: {show(name)}: taken by Rooms[{names.index(name)}]; a name of its own would be right"
    for index, room in enumerate(body.floorplan.Rooms):
        least = LEAST_AREAS_M2[room.Type]
        if room.DesiredShape.Area < least:
            path = f"{FLOORPLAN_PATH}.Rooms[{index}].DesiredShape.Area"
            yield f"{path}: {room.DesiredShape.Area:g}: {least:g} or more would be right for a {room.Type}"
    if len(set(names)) < len(names):
        return  # which room a name means is open
    yield from _connection_problems(body.floorplan.DesiredConnections, names)
    yield from _balcony_problems(body.floorplan)
    for path, target in _room_targets(body):
        yield from _target_problems(target, names, path)


_LATER = 'only in bodies of version 2; leave it out, or set Version to "2"'


def _problems_of_version_1(body: WorldTemplateBody) -> Iterator[str]:
    """Yields problems of a body of version 1 that uses members of version 2."""
    for index, room in enumerate(body.floorplan.Rooms):
        if room.OriginalName is not None:
            yield f"{FLOORPLAN_PATH}.Rooms[{index}].OriginalName: {_LATER}"
    if body.interior.Doorways is not None:
        yield f"{INTERIOR_PATH}.Doorways: {_LATER}"
    for section, sets in _sets(body):
        for index, item in enumerate(sets):
            if isinstance(item.TargetSet, str):
                yield f"{INTERIOR_PATH}.{section}[{index}].TargetSet: {show(item.TargetSet)}: {_LATER}"


def _sets(body: WorldTemplateBody) -> Iterator[tuple[str, Sequence[Any]]]:
    """Yields the sets of an interior that apply to rooms, with their paths."""
    interior = body.interior
    yield "Flooring.MaterialSets", interior.Flooring.MaterialSets
    yield "Walls.MaterialSets", interior.Walls.MaterialSets
    yield "Furniture.FurnitureArrangements", interior.Furniture.FurnitureArrangements


def _room_targets(body: WorldTemplateBody) -> Iterator[tuple[str, TemplateTargetSet]]:
    """Yields each target set that names rooms, with its path; sets for all rooms are left out."""
    for section, sets in _sets(body):
        for index, item in enumerate(sets):
            if not isinstance(item.TargetSet, str):
                yield f"{INTERIOR_PATH}.{section}[{index}].TargetSet", item.TargetSet
    doorways = body.interior.Doorways
    for index, item in enumerate(doorways.DoorwaySets if doorways else []):
        if not isinstance(item.TargetSet, str):
            path = f"{INTERIOR_PATH}.Doorways.DoorwaySets[{index}].TargetSet"
            yield f"{path}.From", item.TargetSet.From
            yield f"{path}.To", item.TargetSet.To


def _target_problems(target: TemplateTargetSet, names: tuple[str, ...], path: str) -> Iterator[str]:
    if (target.RoomNames is None) == (target.RoomTypes is None):
        has = "neither RoomNames nor" if target.RoomNames is None else "both RoomNames and"
        yield f"{path}: has {has} RoomTypes; one of the two would be right"
    for index, name in enumerate(target.RoomNames or []):
        if name not in names:
            yield _no_such_room(f"{path}.RoomNames[{index}]", name, names)


def _no_such_room(path: str, name: str, names: tuple[str, ...]) -> str:
    near = get_close_matches(name, names, n=1)
    advice = f'did you mean "{near[0]}"?' if near else f"the rooms are {', '.join(map(show, names))}"
    return f"{path}: {show(name)}: no such room; {advice}"


def _connection_problems(connections: list[DesiredConnection], names: tuple[str, ...]) -> Iterator[str]:
    kinds: dict[frozenset[str], set[str]] = {}
    degree: Counter[str] = Counter()
    for index, connection in enumerate(connections):
        path = f"{FLOORPLAN_PATH}.DesiredConnections[{index}]"
        unknown = [name for name in connection.Location if name not in names]
        for name in unknown:
            yield _no_such_room(f"{path}.Location[{connection.Location.index(name)}]", name, names)
        if unknown:
            continue
        if len(connection.pair) == 1:
            yield f"{path}.Location: {show(connection.Location)}: two different rooms would be right"
            continue
        for name in connection.Location:
            degree[name] += 1
            if degree[name] == MAX_CONNECTIONS_PER_ROOM + 1:
                most = f"more than {MAX_CONNECTIONS_PER_ROOM} connections"
                yield f"{path}.Location: {show(name)} has {most}; leave one out"
        before = kinds.setdefault(connection.pair, set())
        if before and (connection.ConnectionType == "Opening" or "Opening" in before):
            rule = "one Opening alone, or several Doorways, would be right for one pair of rooms"
            yield f"{path}: {show(connection.Location)} {connection.ConnectionType}: connected before; {rule}"
        before.add(connection.ConnectionType)


def _balcony_problems(plan: TemplateFloorplan) -> Iterator[str]:
    """Yields problems of balconies: too many of them, no room that they belong to, or a connection that is no door."""
    kinds = [room.Type == OUTDOOR_ROOM_TYPE for room in plan.Rooms]
    if all(kinds):
        yield f"{FLOORPLAN_PATH}.Rooms: only of type {OUTDOOR_ROOM_TYPE}; a room inside besides would be right"
    if sum(kinds) > MOST_BALCONIES:
        count = f"{sum(kinds)} of type {OUTDOOR_ROOM_TYPE}"
        yield f"{FLOORPLAN_PATH}.Rooms: {count}; {MOST_BALCONIES} at most would be right"
    outside = {room.Name for room, is_outside in zip(plan.Rooms, kinds, strict=True) if is_outside}
    joined: set[str] = set()
    for index, connection in enumerate(plan.DesiredConnections):
        path, ends = f"{FLOORPLAN_PATH}.DesiredConnections[{index}]", outside & connection.pair
        if len(ends) > 1:
            yield f"{path}.Location: {show(connection.Location)}: two balconies; one room inside would be right"
        elif ends and connection.ConnectionType == "Opening":
            yield f'{path}.ConnectionType: "Opening": "Doorway" would be right for a {OUTDOOR_ROOM_TYPE}'
        elif ends & joined:
            yield f"{path}.Location: {show(connection.Location)}: a {OUTDOOR_ROOM_TYPE} has one door; leave one out"
        joined |= ends


MAX_BODY_CHARACTERS = 262_144
_MAX_REPORTED_PROBLEMS = 20


def parse_template_body(text: str) -> WorldTemplateBody:
    """Parses and checks the JSON body of a world template.

    A body wrapped as `{"name": ..., "templateBody": {...}}`, as the official samples have it, is
    unwrapped.

    Args:
        text: JSON text of at most 262144 characters.

    Raises:
        InvalidParameterException: With one line per problem: JSON path, value, what would be right.
    """
    document, prefix = unwrapped(load_strict(text, "templateBody", MAX_BODY_CHARACTERS))
    body, problems = _read(document)
    if body is not None and not problems:
        return body
    more = len(problems) - _MAX_REPORTED_PROBLEMS
    lines = [prefix + problem for problem in problems[:_MAX_REPORTED_PROBLEMS]]
    raise InvalidParameterException("\n".join([*lines, f"... and {more} more problems"] if more > 0 else lines))


def _read(document: Any) -> tuple[WorldTemplateBody | None, list[str]]:
    """Parses a document to a template's body; returns it with its problems, or `None` with the problems of its form."""
    problems = list(_version_problems(document)) or list(_null_problems(document))
    if problems:
        return None, problems
    try:
        body = WorldTemplateBody.model_validate(document)
    except ValidationError as error:
        found = [_untagged(each) for each in error.errors(include_url=False)]
        misspelt = misspelt_members(found)
        return None, [_explain(each) for each in found if each["type"] != "missing" or each["loc"] not in misspelt]
    return body, list(rule_problems(body))


def body_problems(document: Any) -> list[RequestProblem]:
    """Finds the problems of a world template's body, each with its location.

    Rules are only checked if nothing else is wrong, members only if version and nulls are right.

    Args:
        document: Body as JSON data, without the wrapper of the official samples.
    """
    try:
        load_strict(json.dumps(document), "templateBody", MAX_BODY_CHARACTERS)
    except InvalidParameterException as error:
        return [RequestProblem((), str(error))]
    body, problems = _read(document)
    return [_placed(line, is_rule=body is not None) for line in problems]


# Quantifiers that give nothing back: a long word could else be split in more ways than can ever be tried.
_PATH_AND_MESSAGE = re.compile(r'((?:[A-Za-z_]\w*+|"(?:[^"\\]|\\.)*+"|\[\d++\]|\.)++): (.*)', re.DOTALL)
_PATH_STEP = re.compile(r'([A-Za-z_]\w*)|("(?:[^"\\]|\\.)*")|\[(\d+)\]')


def _placed(line: str, *, is_rule: bool) -> RequestProblem:
    """Converts a text that begins with the path of a member to a problem at that location."""
    if not (match := _PATH_AND_MESSAGE.fullmatch(line)) or match[1] == "body":
        return RequestProblem((), line, is_rule=is_rule)
    steps = _PATH_STEP.finditer(match[1])
    inside = tuple(int(step[3]) if step[3] else json.loads(step[2]) if step[2] else step[1] for step in steps)
    return RequestProblem(inside, match[2], about_key="unknown member" in match[2], is_rule=is_rule)


def unwrapped_text(text: str) -> str:
    """Returns the JSON text of a world template's body, without the wrapper that the official samples have around it.

    Args:
        text: Body that `parse_template_body` accepts.
    """
    document = json.loads(text)
    body, prefix = unwrapped(document)
    return json.dumps(body, ensure_ascii=False) if prefix else text


def unwrapped(document: Any) -> tuple[Any, str]:
    """Returns the template body itself, and the prefix of its paths in the user's document."""
    if is_object(document) and "templateBody" in document and not document.keys() - {"name", "templateBody"}:
        return document["templateBody"], "templateBody."
    return document, ""


def _version_problems(document: Any) -> Iterator[str]:
    """Yields problems of the version, which are reported alone: members of another version would only confuse."""
    if not is_object(document):
        yield f"body: {show(document)}: not a JSON object"
    elif document.get("Version", "1") not in ("1", "2"):
        yield f'Version: {show(document["Version"])}: no such version; "1" or "2", in quotes, would be right'


def _null_problems(value: Any, path: str = "") -> Iterator[str]:
    """Yields problems of null values, which the published schema does not allow: absent members are left out."""
    if is_object(value) or is_list(value):
        entries: Iterable[tuple[str | int, Any]] = value.items() if is_object(value) else enumerate(value)
        for key, item in entries:
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
    """Removes pydantic's tags from an error's location, so that it has only keys of the document."""
    detail["loc"] = tuple(key for key in detail["loc"] if key not in (OBJECT_TAG, CONSTANT_TAG))
    return detail


def _explain(detail: ErrorDetails) -> str:
    """Describes a pydantic error in one line: the member's path, its value, and which value would be right."""
    path = ""
    for key in detail["loc"]:
        path = _join(path, key)
    if detail["type"] == "missing":
        return f"{path}: missing; it is required"
    if detail["type"] == "extra_forbidden":
        known = _members_at(detail["loc"][:-1])
        advice = nearest_of(str(detail["loc"][-1]), known) or f"known here: {', '.join(known)}"
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
    """Describes which value would be valid instead of an invalid one: `a number without quotes would be right`."""
    kind, context = detail["type"], dict(detail.get("ctx", {}))
    if kind == "literal_error" and isinstance(detail["input"], str):
        expected = tuple(re.findall("'([^']+)'", context["expected"]))
        if advice := nearest_of(detail["input"], expected):
            return advice
    if kind == "string_pattern_mismatch":
        of_room = detail["loc"][-3:-2] == ("Rooms",)
        more = "; `OriginalName`, in bodies of version 2, takes any letters" if of_room else ""
        return f"text {pattern_in_words(context['pattern'])} would be right{more}"
    if kind == "float_type":
        return "a number without quotes would be right" if _is_number(detail["input"]) else "a number would be right"
    if kind in _RIGHT:
        return f"{_RIGHT[kind].format_map(context)} would be right"
    message = detail["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return f"{message} would be right" if detail["msg"].startswith("Input should be ") else message


def _is_number(value: object) -> bool:
    return isinstance(value, str) and re.fullmatch(r"\d+(\.\d+)?", value) is not None


def _members_at(location: tuple[int | str, ...]) -> tuple[str, ...]:
    """Returns the names of the members that the object at a location may have."""
    model: Any = WorldTemplateBody
    for key in location:
        if isinstance(key, str):
            annotation = model.model_fields[key].annotation
            while arguments := [argument for argument in get_args(annotation) if argument is not type(None)]:
                annotation = arguments[0]
            model = annotation
    return tuple(model.model_fields)
