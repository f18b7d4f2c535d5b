"""Ten templates of one to six rooms, the guide's examples among them: whose plans are counted."""

from typing import Any

from prefect_robomaker.schemas.templates.body import WorldTemplateBody

Wish = tuple[str, float, float]
"""Type, area and length over width of a room; the types number the rooms."""


def _body(footprint: float, *rooms: Wish, **ways: str) -> WorldTemplateBody:
    """A template; `ways` maps rooms, joined by `_`, to the kind of connection: `Living_Kitchen="Opening"`."""
    names = [
        kind + str(sum(kind == each for each, _, _ in rooms[:number]) or "")
        for number, (kind, _, _) in enumerate(rooms)
    ]
    wishes = [
        {"Name": name, "Type": kind, "DesiredShape": {"Area": area, "AspectRatio": {"x": ratio, "y": 1}}}
        for name, (kind, area, ratio) in zip(names, rooms, strict=True)
    ]
    floorplan: dict[str, Any] = {
        "Footprint": {"DesiredAspectRatio": {"x": footprint, "y": 1}},
        "Rooms": wishes,
        "DesiredConnections": [{"Location": pair.split("_"), "ConnectionType": kind} for pair, kind in ways.items()],
    }
    return WorldTemplateBody.model_validate({"Buildings": [{"Floors": [{"Floorplan": floorplan}]}]})


_THIRD = 4 / 3

TEMPLATES: dict[str, WorldTemplateBody] = {
    "one room": _body(1, ("Living", 20, 1)),
    "first steps": _body(1, ("Living", 24, 1.5), ("Bedroom", 14, 1)),
    "guide": _body(
        1,
        ("Living", 20, 1),
        ("Bedroom", 20, 1),
        ("Bathroom", 10, 1.5),
        Living_Bedroom="Doorway",
        Living_Bathroom="Doorway",
    ),
    "night's flat": _body(1, ("Living", 22, 1.5), ("Bedroom", 14, 1), ("Bathroom", 10, 1)),
    "fits a rectangle": _body(
        _THIRD,
        ("Living", 24, _THIRD),
        ("Kitchen", 12, _THIRD),
        ("Bedroom", 14, _THIRD),
        ("Bathroom", 10, _THIRD),
        Living_Kitchen="Opening",
        Living_Bedroom="Doorway",
        Living_Bathroom="Doorway",
    ),
    "quickstart": _body(
        _THIRD,
        ("Living", 26, 1.5),
        ("Kitchen", 14, _THIRD),
        ("Bedroom", 16, 1),
        ("Bathroom", 10, 1.5),
        Living_Kitchen="Opening",
        Living_Bedroom="Doorway",
        Living_Bathroom="Doorway",
    ),
    "square": _body(
        1, ("Living", 26, _THIRD), ("Kitchen", 14, _THIRD), ("Bedroom", 16, _THIRD), ("Bathroom", 10, _THIRD)
    ),
    "with a hall": _body(
        1.5,
        ("Hallway", 10, 2.5),
        ("Living", 28, 1.5),
        ("Kitchen", 12, 1.2),
        ("Bedroom", 16, 1.3),
        ("Bathroom", 10, 1.5),
        Hallway_Living="Doorway",
        Hallway_Bedroom="Doorway",
        Hallway_Bathroom="Doorway",
        Living_Kitchen="Opening",
    ),
    "night's house": _body(
        1.5,
        ("Hallway", 14, 4),
        ("Living", 32, _THIRD),
        ("Dining", 18, 1),
        ("Kitchen", 16, _THIRD),
        ("Bedroom", 18, 1),
        ("Bathroom", 10, 1.5),
        Hallway_Living="Doorway",
        Hallway_Bedroom="Doorway",
        Hallway_Bathroom="Doorway",
    ),
    "family": _body(
        1,
        ("Hallway", 14, _THIRD),
        ("Living", 32, _THIRD),
        ("Kitchen", 16, _THIRD),
        ("Bedroom", 18, _THIRD),
        ("Bedroom", 13, _THIRD),
        ("Bathroom", 10, _THIRD),
    ),
}
