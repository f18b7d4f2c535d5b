"""Strategies for template bodies of both versions that the published schema and the rules allow."""

import json
from typing import Any

from hypothesis import strategies as st

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.worlds.world import (
    FLOOR_MATERIALS,
    INDOOR_ROOM_TYPES,
    MODEL_TYPES,
    ROOM_TYPES,
    WALL_MATERIALS,
)

AREAS = st.sampled_from([10.0, 12.5, 20.0, 35.0, 80.0]) | st.floats(10, 300)
SIDES = st.sampled_from([1.0, 4.0]) | st.floats(1, 4)
RATIOS = st.fixed_dictionaries({"x": SIDES, "y": SIDES})
NAMES = st.text("abcXYZ019_- ", min_size=1, max_size=12)
DENSITIES = st.sampled_from(["Sparse", "Moderate", "Dense"])
PERCENTS = st.sampled_from([0, 50, 100, "Random"]) | st.floats(0, 100)


@st.composite
def bodies(draw: st.DrawFn, version: str | None = None, most_rooms: int = 6) -> WorldTemplateBody:
    """A valid template body.

    Args:
        draw: Hypothesis's.
        version: "1" or "2"; any of them otherwise.
        most_rooms: Rooms at most.
    """
    return parse_template_body(draw(body_texts(version, most_rooms)))


@st.composite
def body_texts(draw: st.DrawFn, version: str | None = None, most_rooms: int = 6) -> str:
    """The JSON text of a valid template body; see `bodies`."""
    version = version or draw(st.sampled_from(["1", "2"]))
    rooms = draw(st.lists(_rooms(), min_size=1, max_size=most_rooms, unique_by=lambda room: room["Name"]))
    names = [room["Name"] for room in rooms]
    targets = _targets(names) | st.just("Target.All") if version == "2" else _targets(names)
    interior = {
        "Flooring": {"MaterialSets": draw(_sets(targets, _samples("MaterialTypes", FLOOR_MATERIALS, 1)))},
        "Walls": {"MaterialSets": draw(_sets(targets, _samples("MaterialTypes", WALL_MATERIALS, 1)))},
        "Furniture": {
            "FurnitureArrangements": draw(
                _sets(targets, _samples("ModelTypes", MODEL_TYPES, 0), DesiredSpatialDensity=DENSITIES)
            )
        },
    }
    if version == "2":
        interior["Doorways"] = {"DoorwaySets": draw(_doorways(names))}
    floorplan = {
        "Footprint": {"DesiredAspectRatio": draw(RATIOS)},
        "Ceiling": {"Height": draw(st.sampled_from([2.4, 3.0, 4.0]) | st.floats(2.4, 4.0))},
        "Rooms": rooms,
        "DesiredConnections": draw(_connections(names)),
    }
    floor = {"Floorplan": floorplan, "Interior": interior}
    return json.dumps({"Version": version, "Buildings": [{"Floors": [floor]}]})


def _rooms() -> st.SearchStrategy[dict[str, Any]]:
    shape = st.fixed_dictionaries({"Area": AREAS, "AspectRatio": RATIOS})
    return st.fixed_dictionaries({"Type": st.sampled_from(INDOOR_ROOM_TYPES), "Name": NAMES, "DesiredShape": shape})


def _targets(names: list[str]) -> st.SearchStrategy[Any]:
    by_name = st.lists(st.sampled_from(names), min_size=1, max_size=6, unique=True)
    by_type = st.lists(st.sampled_from(ROOM_TYPES), min_size=1, max_size=7, unique=True)
    return by_name.map(lambda some: {"RoomNames": some}) | by_type.map(lambda some: {"RoomTypes": some})


def _samples(member: str, values: tuple[str, ...], least: int) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({member: st.lists(st.sampled_from(values), min_size=least, max_size=8, unique=True)})


def _sets(
    targets: st.SearchStrategy[Any], samples: st.SearchStrategy[Any], **more: st.SearchStrategy[Any]
) -> st.SearchStrategy[list[dict[str, Any]]]:
    one = st.fixed_dictionaries({"Name": NAMES, "TargetSet": targets}, optional={"SampleSet": samples, **more})
    return st.lists(one, max_size=3)


def _doorways(names: list[str]) -> st.SearchStrategy[list[dict[str, Any]]]:
    pairs = st.fixed_dictionaries({"From": _targets(names), "To": _targets(names)})
    position = st.fixed_dictionaries({"Percent": PERCENTS})
    door = st.fixed_dictionaries({"InitialState": st.fixed_dictionaries({"OpenPosition": position})})
    one = st.fixed_dictionaries({"Name": NAMES, "TargetSet": pairs | st.just("Target.All")}, optional={"Door": door})
    return st.lists(one, max_size=3)


@st.composite
def _connections(draw: st.DrawFn, names: list[str]) -> list[dict[str, Any]]:
    """Wished ways that keep the rules: at most four at a room, an Opening alone in its pair."""
    if len(names) < 2:
        return []
    pair = st.lists(st.sampled_from(names), min_size=2, max_size=2, unique=True)
    kinds: dict[frozenset[str], str] = {}
    found: list[dict[str, Any]] = []
    for location, kind in draw(st.lists(st.tuples(pair, st.sampled_from(["Doorway", "Opening"])), max_size=8)):
        before = kinds.get(frozenset(location))
        full = any(sum(name in link["Location"] for link in found) == 4 for name in location)
        if not full and (before is None or before == kind == "Doorway"):
            kinds[frozenset(location)] = kind
            found.append({"Location": location, "ConnectionType": kind})
    return found
