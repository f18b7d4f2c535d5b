"""Template bodies drawn at random, as unfiltered as schema and rules allow: what a world generator has to bear."""

import json
from collections import Counter
from math import exp, log
from random import Random
from typing import Any

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import MAX_CONNECTIONS_PER_ROOM, parse_template_body
from prefect_robomaker.schemas.worlds.world import MODEL_TYPES, SERVICE_ROOM_TYPES

MOST_ROOMS = 6
MOST_CONNECTIONS = 12
DENSITIES = ("Sparse", "Moderate", "Dense")


def random_template(seed: int, *, balconies: bool = False) -> WorldTemplateBody:
    """One of the bodies: any number, size, shape and type of rooms, any connections, doors in any state.

    With balconies it is the same body with one or two of them besides, some with a wished door.
    """
    dice = Random(seed)
    version = dice.choice("12")
    rooms = [_room(dice, number) for number in range(dice.randint(1, MOST_ROOMS))]
    names = [room["Name"] for room in rooms]
    floorplan = {
        "Footprint": {"DesiredAspectRatio": _ratio(dice)},
        "Ceiling": {"Height": round(dice.uniform(2.4, 4.0), 2)},
        "Rooms": rooms,
        "DesiredConnections": _connections(dice, names),
    }
    furniture = [_arrangement(dice, names, number) for number in range(dice.randint(0, 2))]
    interior: dict[str, Any] = {"Furniture": {"FurnitureArrangements": furniture}}
    if version == "2":
        interior["Doorways"] = {"DoorwaySets": [_doors(dice)]}
    if balconies:
        _add_balconies(floorplan, Random(f"balconies of {seed}"))
    floor = {"Floorplan": floorplan, "Interior": interior}
    return parse_template_body(json.dumps({"Version": version, "Buildings": [{"Floors": [floor]}]}))


def _room(dice: Random, number: int) -> dict[str, Any]:
    kind = dice.choice(SERVICE_ROOM_TYPES)
    # Small rooms are as frequent as large ones: each doubling of the area is as likely as the next.
    area = round(exp(dice.uniform(log(10), log(300))), 1)
    return {"Name": f"{kind} {number}", "Type": kind, "DesiredShape": {"Area": area, "AspectRatio": _ratio(dice)}}


def _add_balconies(floorplan: dict[str, Any], dice: Random) -> None:
    """Adds one or two balconies from 2 to 12 m2, anywhere among the rooms."""
    inside = [room["Name"] for room in floorplan["Rooms"]]
    busy = Counter(name for way in floorplan["DesiredConnections"] for name in way["Location"])
    for number in range(dice.randint(1, 2)):
        area = round(exp(dice.uniform(log(2), log(12))), 1)
        room = {
            "Name": f"Balcony {number}", "Type": "Balcony", "DesiredShape": {"Area": area, "AspectRatio": _ratio(dice)},
        }  # fmt: skip
        floorplan["Rooms"].insert(dice.randint(0, len(floorplan["Rooms"])), room)
        host = dice.choice(inside)
        if dice.random() < 0.5 and busy[host] < MAX_CONNECTIONS_PER_ROOM:
            floorplan["DesiredConnections"].append({"Location": [room["Name"], host], "ConnectionType": "Doorway"})
            busy[host] += 1


def _ratio(dice: Random) -> dict[str, float]:
    longer = round(exp(dice.uniform(0, log(4))), 2)
    return {"x": longer, "y": 1.0} if dice.random() < 0.5 else {"x": 1.0, "y": longer}


def _connections(dice: Random, names: list[str]) -> list[dict[str, Any]]:
    """Any connections that the rules allow: at most four at a room, and an Opening alone in its pair."""
    found: list[dict[str, Any]] = []
    degrees: Counter[str] = Counter()
    kinds: dict[frozenset[str], str] = {}
    for _ in range(dice.randint(0, MOST_CONNECTIONS) if len(names) > 1 else 0):
        pair, kind = dice.sample(names, 2), dice.choice(("Doorway", "Doorway", "Opening"))
        before = kinds.get(frozenset(pair))
        if max(degrees[name] for name in pair) < MAX_CONNECTIONS_PER_ROOM and before in (None, "Doorway"):
            if before is not None and kind == "Opening":
                continue
            found.append({"Location": pair, "ConnectionType": kind})
            degrees.update(pair)
            kinds[frozenset(pair)] = kind
    return found


def _arrangement(dice: Random, names: list[str], number: int) -> dict[str, Any]:
    """Furniture of some rooms; half of them leave the kinds open."""
    some = dice.sample(names, dice.randint(1, len(names)))
    made: dict[str, Any] = {
        "Name": f"set {number}",
        "TargetSet": {"RoomNames": some},
        "DesiredSpatialDensity": dice.choice(DENSITIES),
    }
    if dice.random() < 0.5:
        made["SampleSet"] = {"ModelTypes": dice.sample(MODEL_TYPES, dice.randint(0, 8))}
    return made


def _doors(dice: Random) -> dict[str, Any]:
    percent = dice.choice((0, 25, 50, 100, "Random"))
    door = {"InitialState": {"OpenPosition": {"Percent": percent}}}
    return {"Name": "all", "TargetSet": "Target.All", "Door": door}
