"""The rules for template bodies that the published schema leaves to prose.

Names must be unique and exist, connections must not contradict each other, and bodies of version 1 have
nothing that came with version 2.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import Any

from ..wire.strict_json import show
from .body import FLOORPLAN_PATH, INTERIOR_PATH, DesiredConnection, WorldTemplateBody
from .targets import TemplateTargetSet

MAX_CONNECTIONS_PER_ROOM = 4


def rule_problems(body: WorldTemplateBody) -> Iterator[str]:
    """The rules that the guide gives in prose."""
    if body.Version == "1":
        yield from _version_problems(body)
    names = tuple(room.Name for room in body.floorplan.Rooms)
    for index, name in enumerate(names):
        if name in names[:index]:
            path = f"{FLOORPLAN_PATH}.Rooms[{index}].Name"
            yield f"{path}: {show(name)}: taken by Rooms[{names.index(name)}]; a name of its own would be right"
    if len(set(names)) < len(names):
        return  # which room a name means is open
    yield from _connection_problems(body.floorplan.DesiredConnections, names)
    for path, target in _room_targets(body):
        yield from _target_problems(target, names, path)


_LATER = 'only in bodies of version 2; leave it out, or set Version to "2"'


def _version_problems(body: WorldTemplateBody) -> Iterator[str]:
    """Problems of a body of version 1 that uses members of version 2."""
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
    """The sets for rooms, by where they stand in the interior."""
    interior = body.interior
    yield "Flooring.MaterialSets", interior.Flooring.MaterialSets
    yield "Walls.MaterialSets", interior.Walls.MaterialSets
    yield "Furniture.FurnitureArrangements", interior.Furniture.FurnitureArrangements


def _room_targets(body: WorldTemplateBody) -> Iterator[tuple[str, TemplateTargetSet]]:
    """Everything that names rooms, with its path; not what is for all of them."""
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
