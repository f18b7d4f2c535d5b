"""Template bodies: what is accepted, what is refused, and in which words."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.wire.errors import InvalidParameterException

FLOORPLAN = "Buildings[0].Floors[0].Floorplan"
INTERIOR = "Buildings[0].Floors[0].Interior"


def body(floorplan: Any = None, interior: Any = None) -> dict[str, Any]:
    return {"Buildings": [{"Floors": [{"Floorplan": floorplan or {}, "Interior": interior or {}}]}]}


def room(name: str = "A", kind: str = "Living", area: float = 20, x: float = 1, y: float = 1) -> dict[str, Any]:
    return {"Type": kind, "Name": name, "DesiredShape": {"Area": area, "AspectRatio": {"x": x, "y": y}}}


def link(one: str = "A", other: str = "B", kind: str = "Doorway") -> dict[str, Any]:
    return {"Location": [one, other], "ConnectionType": kind}


def refusal(document: Any) -> str:
    text = document if isinstance(document, str) else json.dumps(document)
    with pytest.raises(InvalidParameterException) as caught:
        parse_template_body(text)
    return str(caught.value)


FULL = {
    "Version": "1",
    "Buildings": [
        {
            "Floors": [
                {
                    "Floorplan": {
                        "Footprint": {"DesiredAspectRatio": {"x": 4, "y": 3}},
                        "Ceiling": {"Height": 2.4},
                        "Rooms": [room("Living Room"), room("Bath_1-a", "Bathroom", 10, 1, 2)],
                        "DesiredConnections": [link("Living Room", "Bath_1-a")],
                    },
                    "Interior": {
                        "Flooring": {
                            "MaterialSets": [
                                {
                                    "Name": "wood",
                                    "TargetSet": {"RoomNames": ["Living Room"]},
                                    "SampleSet": {"MaterialTypes": ["Floorboards", "Carpet"]},
                                }
                            ]
                        },
                        "Walls": {
                            "MaterialSets": [
                                {
                                    "Name": "wet",
                                    "TargetSet": {"RoomTypes": ["Bathroom"]},
                                    "SampleSet": {"MaterialTypes": ["Tiles"]},
                                },
                                {"Name": "rest", "TargetSet": {"RoomTypes": ["Living"]}},
                            ]
                        },
                        "Furniture": {
                            "FurnitureArrangements": [
                                {
                                    "Name": "empty",
                                    "TargetSet": {"RoomTypes": ["Bathroom"]},
                                    "SampleSet": {"ModelTypes": []},
                                    "DesiredSpatialDensity": "Dense",
                                },
                                {"Name": "any", "TargetSet": {"RoomNames": ["Living Room"]}},
                            ]
                        },
                    },
                }
            ]
        }
    ],
}


def test_the_empty_body_means_one_default_room() -> None:
    parsed = parse_template_body("{}")
    (only,) = parsed.floorplan.Rooms
    assert (only.Name, only.Type, only.DesiredShape.Area) == ("My Living Room", "Living", 20)
    assert parsed.floorplan.Ceiling.Height == 3.0
    assert parsed.floorplan.DesiredConnections == []
    assert parsed.interior.Furniture.FurnitureArrangements == []


def test_a_full_body_is_read_as_it_is() -> None:
    parsed = parse_template_body(json.dumps(FULL))
    assert [item.Name for item in parsed.floorplan.Rooms] == ["Living Room", "Bath_1-a"]
    arrangements = parsed.interior.Furniture.FurnitureArrangements
    assert arrangements[0].SampleSet is not None
    assert arrangements[0].SampleSet.ModelTypes == []
    assert arrangements[1].SampleSet is None
    assert [item.DesiredSpatialDensity for item in arrangements] == ["Dense", "Moderate"]


def test_the_wrapper_of_the_official_samples_is_taken_off() -> None:
    wrapped = parse_template_body(json.dumps({"name": "x", "templateBody": FULL}))
    assert wrapped == parse_template_body(json.dumps(FULL))
    assert refusal({"name": "x", "templateBody": {"Version": 1}}).startswith("templateBody.Version: 1: ")


def test_equal_wishes_have_equal_canonical_text_which_parses_to_themselves() -> None:
    full = parse_template_body(json.dumps(FULL))
    shuffled = json.dumps(FULL, sort_keys=True, indent=3).replace("2.4", "2.40")
    assert parse_template_body(shuffled).canonical() == full.canonical()
    assert parse_template_body(full.canonical()) == full
    assert parse_template_body("{}").canonical() == WorldTemplateBody().canonical()
    assert "null" not in full.canonical()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "templateBody: 0 characters; 1 to 262144 would be right"),
        (" " * 262_143 + "{}", "templateBody: 262145 characters; 1 to 262144 would be right"),
        ("{,}", "templateBody: not JSON: "),
        ('{"Buildings": []\n"Version": "1"}', "at line 2, column 1"),
        ('{"Version": "1", "Version": "1"}', 'templateBody: member "Version" is there 2 times in one object'),
        ('{"Buildings": NaN}', "templateBody: NaN is not a JSON number"),
        ('{"Buildings": -Infinity}', "templateBody: -Infinity is not a JSON number"),
        ("[" * 100_000, "templateBody: nested more than 32 levels deep"),
        ("1" * 5000, "templateBody: a number has too many digits"),
        ("[]", "body: []: not a JSON object"),
        ("null", "body: null: not a JSON object"),
        ('{"Version": "3", "Doors": 1}', 'Version: "3": no such version; "1" or "2", in quotes, would be right'),
        ('{"Version": 1}', 'Version: 1: no such version; "1" or "2", in quotes, would be right'),
        ('{"Version": "2", "Doors": 1}', "Doors: unknown member; known here: Version, Buildings"),
        ('{"Buildings": [{"Floors": [],}],}', "templateBody: not JSON: "),
        ('{"Buildings": null}', "Buildings: null: not allowed; leave it out instead"),
        ('{"buildings": []}', 'buildings: unknown member; did you mean "Buildings"?'),
        ('{"Buildings": []}', "Buildings: []: "),
        ('{"a\\nb": 1}', '"a\\nb": unknown member'),
        ('{"a": "\\ud800"}', "templateBody: holds half of a surrogate pair"),
        ('{"a":' * 40 + "1" + "}" * 40, "templateBody: nested more than 32 levels deep"),
        ('{"a":' * 900 + "1" + "}" * 900, "templateBody: nested more than 32 levels deep"),
    ],
)
def test_text_that_is_no_body_is_refused(text: str, message: str) -> None:
    assert message in refusal(text)


@pytest.mark.parametrize(
    ("floorplan", "message"),
    [
        ({"Rooms": []}, f"{FLOORPLAN}.Rooms: []: "),
        ({"Rooms": [room(str(i)) for i in range(13)]}, f"{FLOORPLAN}.Rooms: "),
        ({"Rooms": [room(area=1.9)]}, "Rooms[0].DesiredShape.Area: 1.9: 2 or more would be right"),
        ({"Rooms": [room(area=4.9)]}, "Rooms[0].DesiredShape.Area: 4.9: 5 or more would be right for a Living"),
        ({"Rooms": [room(area=301)]}, "Rooms[0].DesiredShape.Area: 301: 300 or less would be right"),
        ({"Rooms": [room(x=0.9)]}, "Rooms[0].DesiredShape.AspectRatio.x: 0.9: 1 or more"),
        ({"Rooms": [room(y=4.1)]}, "Rooms[0].DesiredShape.AspectRatio.y: 4.1: 4 or less"),
        ({"Rooms": [room(area=True)]}, "Rooms[0].DesiredShape.Area: true: a number would be right"),
        ({"Rooms": [room(kind="living")]}, 'Rooms[0].Type: "living": did you mean "Living"?'),
        ({"Rooms": [room(name="")]}, 'Rooms[0].Name: "": '),
        ({"Rooms": [room(name="Café")]}, 'Rooms[0].Name: "Café": '),
        ({"Rooms": [room(name="a\n")]}, 'Rooms[0].Name: "a\\n": '),
        ({"Rooms": [room(name="n" * 256)]}, "Rooms[0].Name: "),
        ({"Rooms": [{"Name": "A"}]}, "Rooms[0].Type: missing; it is required"),
        ({"Rooms": [room(), room()]}, 'Rooms[1].Name: "A": taken by Rooms[0]; a name of its own would be right'),
        ({"Ceiling": {"Height": 2.3}}, "Ceiling.Height: 2.3: 2.4 or more would be right"),
        ({"Ceiling": {"Height": "3"}}, 'Ceiling.Height: "3": a number without quotes would be right'),
        ({"Footprint": {"DesiredAspectRatio": {"x": 5}}}, "Footprint.DesiredAspectRatio.x: 5: 4 or less"),
        ({"Footprint": {"AspectRatio": {}}}, 'AspectRatio: unknown member; did you mean "DesiredAspectRatio"?'),
    ],
)
def test_wrong_plans_are_refused_with_path_value_and_advice(floorplan: Any, message: str) -> None:
    assert message in refusal(body(floorplan))


@pytest.mark.parametrize(
    ("connections", "message"),
    [
        ([link("A", "Kichen")], 'Location[1]: "Kichen": no such room; did you mean "Kitchen"?'),
        ([link("A", "zzz")], 'Location[1]: "zzz": no such room; the rooms are "A", "B", "Kitchen"'),
        ([link("A", "A")], 'Location: ["A", "A"]: two different rooms would be right'),
        ([link("A", "B", "Door")], 'DesiredConnections[0].ConnectionType: "Door": did you mean "Doorway"?'),
        ([{"Location": ["A"], "ConnectionType": "Opening"}], "DesiredConnections[0].Location: "),
        ([link()] * 5, 'DesiredConnections[4].Location: "A" has more than 4 connections'),
        ([link()] * 25, "DesiredConnections: "),
        ([link(kind="Opening")] * 2, 'DesiredConnections[1]: ["A", "B"] Opening: connected before'),
        ([link(), link("B", "A", "Opening")], 'DesiredConnections[1]: ["B", "A"] Opening: connected before'),
        ([link(kind="Opening"), link()], 'DesiredConnections[1]: ["A", "B"] Doorway: connected before'),
    ],
)
def test_wrong_connections_are_refused(connections: list[Any], message: str) -> None:
    rooms = [room("A"), room("B"), room("Kitchen", "Kitchen")]
    assert message in refusal(body({"Rooms": rooms, "DesiredConnections": connections}))


def test_several_doorways_may_join_one_pair() -> None:
    parsed = parse_template_body(
        json.dumps(body({"Rooms": [room("A"), room("B")], "DesiredConnections": [link()] * 4}))
    )
    assert len(parsed.floorplan.DesiredConnections) == 4


def named(target: Any, **sample: Any) -> dict[str, Any]:
    return {"Name": "set", "TargetSet": target} | sample


LIVING = {"RoomTypes": ["Living"]}


@pytest.mark.parametrize(
    ("interior", "message"),
    [
        ({"Walls": {"MaterialSets": [named({})]}}, "Walls.MaterialSets[0].TargetSet: has neither"),
        (
            {"Walls": {"MaterialSets": [named({"RoomNames": ["My Living Room"], "RoomTypes": ["Living"]})]}},
            "Walls.MaterialSets[0].TargetSet: has both RoomNames and RoomTypes; one of the two would be right",
        ),
        (
            {"Flooring": {"MaterialSets": [named({"RoomNames": ["Living"]})]}},
            'Flooring.MaterialSets[0].TargetSet.RoomNames[0]: "Living": no such room; did you mean "My Living Room"?',
        ),
        ({"Flooring": {"MaterialSets": [named({"RoomTypes": ["Attic"]})]}}, 'RoomTypes[0]: "Attic": '),
        (
            {"Walls": {"MaterialSets": [named(LIVING, SampleSet={"MaterialTypes": ["Wood panels"]})]}},
            'MaterialTypes[0]: "Wood panels": not a wall material; did you mean "WoodPanels"?',
        ),
        (
            {"Flooring": {"MaterialSets": [named(LIVING, SampleSet={"MaterialTypes": ["Lava"]})]}},
            '"Lava": not a floor material; one of Carpet, Concrete, Floorboards, Linoleum, Parquetry, Tiles would be',
        ),
        ({"Flooring": {"MaterialSets": [named(LIVING, SampleSet={"MaterialTypes": []})]}}, "MaterialTypes: []: "),
        ({"Flooring": {"MaterialSets": [named(LIVING, SampleSet=None)]}}, "SampleSet: null: not allowed; leave it out"),
        ({"Flooring": {"MaterialSets": [named(LIVING)] * 13}}, "Flooring.MaterialSets: "),
        (
            {"Furniture": {"FurnitureArrangements": [named(LIVING, SampleSet={"ModelTypes": ["Sofa"]})]}},
            'ModelTypes[0]: "Sofa": not a model type; did you mean "Sofas"?',
        ),
        (
            {"Furniture": {"FurnitureArrangements": [named(LIVING, SampleSet={"ModelTypes": [], "Desired": 1})]}},
            "SampleSet.Desired: unknown member; known here: ModelTypes",
        ),
        (
            {
                "Furniture": {
                    "FurnitureArrangements": [
                        named(LIVING, SampleSet={"ModelTypes": ["Beds"], "DesiredSpatialDensity": "Dense"})
                    ]
                }
            },
            "SampleSet.DesiredSpatialDensity: unknown member; known here: ModelTypes",
        ),
        (
            {"Furniture": {"FurnitureArrangements": [named(LIVING, DesiredSpatialDensity="Full")]}},
            'DesiredSpatialDensity: "Full": ',
        ),
    ],
)  # fmt: skip
def test_wrong_interiors_are_refused(interior: Any, message: str) -> None:
    text = refusal(body(interior=interior))
    assert message in text
    assert text.startswith(INTERIOR)


def test_every_problem_is_a_line_of_its_own() -> None:
    lines = refusal(body({"Rooms": [room(area=1, x=9)], "Roofs": 1})).splitlines()
    assert len(lines) == 3
    assert all(line.startswith(FLOORPLAN) for line in lines)


def test_a_flood_of_problems_is_cut_short() -> None:
    lines = refusal({f"member{index}": 1 for index in range(500)}).splitlines()
    assert lines[-1] == "... and 480 more problems"
    assert len(lines) == 21


JSON = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.integers() | st.text(),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["Version", "Buildings", "Floors", "Floorplan", "Rooms", "Name", "templateBody"])
            | st.text(),
            inner,
            max_size=3,
        )
    ),
    max_leaves=8,
)


def outcome(text: str) -> WorldTemplateBody | str:
    """The body, or the words in which it is refused; no other exception."""
    try:
        return parse_template_body(text)
    except InvalidParameterException as error:
        return str(error)


@given(JSON)
def test_anything_is_either_a_body_or_refused_in_printable_lines(document: Any) -> None:
    result = outcome(json.dumps(document))
    if isinstance(result, str):
        assert all(line.isprintable() for line in result.split("\n"))
    else:
        assert parse_template_body(result.canonical()) == result


@given(st.text(max_size=60))
def test_any_text_is_either_a_body_or_refused(text: str) -> None:
    assert outcome(text)
