"""Template bodies of version 2: what they add, and that version 1 does not have it."""

import json
from typing import Any

import pytest

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.wire.errors import InvalidParameterException

DOORWAYS = "Buildings[0].Floors[0].Interior.Doorways"
ROOMS = [{"Type": "Living", "Name": "A"}, {"Type": "Bedroom", "Name": "B", "OriginalName": "Schlafzimmer für Gäste"}]


def parse(
    floorplan: dict[str, Any] | None = None, version: str | None = "2", **interior: dict[str, Any]
) -> WorldTemplateBody:
    floor = {"Floorplan": {"Rooms": ROOMS} if floorplan is None else floorplan, "Interior": interior}
    document: dict[str, Any] = {"Buildings": [{"Floors": [floor]}]}
    return parse_template_body(json.dumps(document if version is None else document | {"Version": version}))


def refusal(*arguments: Any, **interior: Any) -> str:
    with pytest.raises(InvalidParameterException) as caught:
        parse(*arguments, **interior)
    return str(caught.value)


def doorways(target: Any = "Target.All", percent: Any = 50, count: int = 1) -> dict[str, Any]:
    door = {"InitialState": {"OpenPosition": {"Percent": percent}}}
    return {"DoorwaySets": [{"Name": "doors", "TargetSet": target, "Door": door}] * count}


PAIR = {"From": {"RoomNames": ["A"]}, "To": {"RoomTypes": ["Bedroom", "Closet"]}}


@pytest.mark.parametrize("text", ['{"Version": "2"}', '{"Version": "2", "Buildings": [{"Floors": [{}]}]}'])
def test_the_default_room_has_the_name_of_version_2(text: str) -> None:
    (room,) = parse_template_body(text).floorplan.Rooms
    assert (room.Type, room.Name, room.OriginalName) == ("Living", "My_Living_Room", "My Living Room")
    assert room.DesiredShape.Area == 20


def test_no_rooms_at_all_are_as_wrong_as_in_version_1() -> None:
    assert "Floorplan.Rooms: []: 1 or more entries would be right" in refusal({"Rooms": []})


def test_doorway_sets_are_read_as_they_are() -> None:
    body = parse(Doorways={"DoorwaySets": [*doorways(PAIR, "Random")["DoorwaySets"], {"Name": "x", "TargetSet": PAIR}]})
    assert body.interior.Doorways is not None
    first, second = body.interior.Doorways.DoorwaySets
    assert first.Door.InitialState.OpenPosition.Percent == "Random"
    assert second.Door.InitialState.OpenPosition.Percent == 100
    assert not isinstance(first.TargetSet, str)
    assert first.TargetSet.From.RoomNames == ["A"]
    assert first.TargetSet.To.RoomTypes == ["Bedroom", "Closet"]
    assert parse_template_body(body.canonical()) == body


@pytest.mark.parametrize("percent", [0, 50, 70.5, 100, "Random"])
def test_a_door_is_open_by_a_percentage_or_at_random(percent: Any) -> None:
    body = parse(Doorways=doorways(percent=percent))
    assert body.interior.Doorways is not None
    assert body.interior.Doorways.DoorwaySets[0].Door.InitialState.OpenPosition.Percent == percent


@pytest.mark.parametrize("percent", [-1, 100.1, 1e300, True, "50", "random", [], {}])
def test_anything_else_is_no_opening(percent: Any) -> None:
    (line,) = refusal(Doorways=doorways(percent=percent)).splitlines()
    assert line.startswith(f"{DOORWAYS}.DoorwaySets[0].Door.InitialState.OpenPosition.Percent: ")
    assert line.endswith(': a number from 0 to 100, or "Random", would be right')


@pytest.mark.parametrize("part", ["Flooring", "Walls", "Furniture"])
def test_any_set_may_be_for_all_rooms(part: str) -> None:
    sets = "FurnitureArrangements" if part == "Furniture" else "MaterialSets"
    wish = {part: {sets: [{"Name": "x", "TargetSet": "Target.All"}]}}
    parse(None, "2", **wish)
    assert f'{part}.{sets}[0].TargetSet: "Target.All": only in bodies of version 2' in refusal(None, "1", **wish)
    misspelt = {part: {sets: [{"Name": "x", "TargetSet": "Target.Al"}]}}
    assert 'TargetSet: "Target.Al": did you mean "Target.All"?' in refusal(None, "2", **misspelt)


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (doorways(count=14), "DoorwaySets: "),
        (doorways(5), "DoorwaySets[0].TargetSet: 5: an object would be right"),
        (doorways({"From": {"RoomNames": ["A"]}}), "DoorwaySets[0].TargetSet.To: missing; it is required"),
        (doorways(PAIR | {"Via": 1}), "DoorwaySets[0].TargetSet.Via: unknown member; known here: From, To"),
        (doorways(PAIR | {"To": {}}), "DoorwaySets[0].TargetSet.To: has neither RoomNames nor RoomTypes"),
        (doorways(PAIR | {"To": "Target.All"}), 'DoorwaySets[0].TargetSet.To: "Target.All": an object would be right'),
        (
            doorways(PAIR | {"From": {"RoomNames": ["A", "C"]}}),
            'TargetSet.From.RoomNames[1]: "C": no such room; the rooms are "A", "B"',
        ),
        (doorways(PAIR | {"From": {"RoomTypes": ["Cellar"]}}), 'TargetSet.From.RoomTypes[0]: "Cellar": '),
        ({"DoorwaySets": [{"TargetSet": "Target.All"}]}, "DoorwaySets[0].Name: missing; it is required"),
        ({"DoorwaySets": [{"Name": "x"}]}, "DoorwaySets[0].TargetSet: missing; it is required"),
        ({"DoorwaySets": None}, "DoorwaySets: null: not allowed; leave it out instead"),
    ],
)  # fmt: skip
def test_wrong_doorway_sets_are_refused(sets: dict[str, Any], message: str) -> None:
    text = refusal(Doorways=sets)
    assert text.startswith(DOORWAYS)
    assert message in text


def test_a_room_name_in_other_letters_is_told_where_it_may_be() -> None:
    assert refusal({"Rooms": [{"Type": "Kitchen", "Name": "Küche"}]}) == (
        'Buildings[0].Floors[0].Floorplan.Rooms[0].Name: "Küche": text of letters, digits, _, - and spaces would be '
        "right; `OriginalName`, in bodies of version 2, takes any letters"
    )
    odd = {**doorways()["DoorwaySets"][0], "Name": "Türen"}
    assert "OriginalName" not in refusal(Doorways={"DoorwaySets": [odd]})


@pytest.mark.parametrize("name", ["a\x1b[31m", "a\x9b31m", "a\nb"])
def test_original_names_have_no_control_characters(name: str) -> None:
    told = refusal({"Rooms": [{"Type": "Kitchen", "Name": "Kuche", "OriginalName": name}]})
    assert told.startswith("Buildings[0].Floors[0].Floorplan.Rooms[0].OriginalName: ")
    assert told.endswith(f": a name has no control characters; remove U+{ord(name[1]):04X}")


@pytest.mark.parametrize("version", ["1", None])
def test_version_1_has_no_doors_and_no_original_names(version: str | None) -> None:
    assert refusal({"Rooms": ROOMS[:1]}, version, Doorways=doorways()) == (
        f'{DOORWAYS}: only in bodies of version 2; leave it out, or set Version to "2"'
    )
    assert "Rooms[1].OriginalName: only in bodies of version 2" in refusal(None, version)
    assert parse({"Rooms": ROOMS[:1]}, version).Version == "1"
