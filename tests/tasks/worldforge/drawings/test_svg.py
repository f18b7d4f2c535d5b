"""SVG files as programs write them: transforms, paths, sizes on paper, names and layers."""

import pytest

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.tasks.worldforge.drawings.drawn_shapes import kind_of, room_type
from prefect_robomaker.tasks.worldforge.drawings.room_finding import metres_per_unit, read_plan
from prefect_robomaker.tasks.worldforge.drawings.svg import read_svg
from prefect_robomaker.tasks.worldforge.drawings.svg_paths import PathError, path_parts

INKSCAPE = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"
  width="210mm" height="297mm" viewBox="0 0 210 297">
  <defs><rect id="Kitchen-template" width="9" height="9"/></defs>
  <g inkscape:groupmode="layer" inkscape:label="Rooms" transform="translate(10,20) scale(2)">
    <path id="path1-2" inkscape:label="Kitchen" d="m 0,0 h 20 v 15 h -20 z"/>
    <g transform="rotate(90)"><rect id="rect7" x="0" y="-45" width="15" height="25"/></g>
  </g>
  <g inkscape:label="Doors"><path d="M 50 30 L 50 37 A 7 7 0 0 1 43 30" id="path9"/></g>
  <text x="80" y="35"><tspan x="80" y="35">Bedroom</tspan> 12,5 m²</text>
  <rect style="display:none" id="Bath" width="5" height="5"/>
</svg>"""


def test_layers_transforms_and_texts_of_a_drawing_program() -> None:
    drawing = read_svg(INKSCAPE.encode(), "flat.svg")
    assert [kind_of(shape, drawing.labels) for shape in drawing.shapes] == ["room", "room", "door"]
    scale = metres_per_unit(drawing, "1:100", "flat.svg")
    assert scale == pytest.approx(0.1)
    plan, left_out = read_plan(drawing, scale, DrawingNotes(), "flat.svg")
    assert [(room.name, room.type) for room in plan.rooms] == [("Kitchen", "Kitchen"), ("Bedroom", "Bedroom")]
    kitchen, bedroom = ([min(axis) for axis in zip(*room.corners, strict=True)] for room in plan.rooms)
    assert (kitchen, bedroom) == (pytest.approx([1, -5]), pytest.approx([5, -5]))
    assert left_out == []
    assert drawing.left_out == ["1 hidden <rect>"]


def test_paths_in_all_ways_of_writing() -> None:
    square = ((0, 0), (4, 0), (4, 3), (0, 3))

    def first(d: str) -> tuple[object, ...]:
        return path_parts(d)[0][:3]

    assert first("M0 0H4V3H0Z") == (square, True, False)
    assert first("m0,0 4,0 0,3 -4,0z") == (square, True, False)
    assert first("M 0 0 L 4 0 4 3 0 3 0 0") == ((*square, (0, 0)), True, False)
    assert first("M0 0 A4 4 0 0 1 4 4") == (((0, 0), (4, 4)), False, True)
    assert first("M0 0H4V3H0Z M1 1h1v1z") == (square, True, False)
    assert [part.points for part in path_parts("m1 1h4v3h-4zm1 1h1v1zh2")][1:] == [
        ((2, 2), (3, 2), (3, 3)), ((2, 2), (4, 2)),
    ], "a part begins where the one before it was closed"  # fmt: skip
    for wrong in ("4 0 L 4 3", "L 4 3", "Z", "M0 0H1Z 4"):
        with pytest.raises(PathError):
            path_parts(wrong)


@pytest.mark.parametrize(
    ("d", "hinge"),
    [
        ("M90 0 A90 90 0 0 1 0 90", (0, 0)),
        ("M90 0 A90 90 0 0 0 0 90", (90, 90)),
        ("M90 0 a90 90 0 0 1 -90 90", (0, 0)),
        ("M90 0 A90 90 0 1 0 0 90", (0, 0)),
        ("M90 0 q0 90 -90 90", (0, 0)),
        ("M90 0 C90 49.7 49.7 90 0 90", (0, 0)),
        ("M90 0 A90 90 0 0 1 45 77.94", (0, 0)),
        ("M90 0 A90 40 0 0 1 0 90", None),
        ("M90 0 C60 20 20 60 0 90", None),
        ("M90 0 Q45 45 0 90", None),
    ],
)
def test_the_hinge_of_an_arc_is_its_centre(d: str, hinge: tuple[float, float] | None) -> None:
    [part] = path_parts(d)
    assert [swing.hinge for swing in part.swings] == ([] if hinge is None else [pytest.approx(hinge, abs=0.1)])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Master Bedroom", "Bedroom"),
        ("masterbedroom", "Bedroom"),
        ("Bedroom closet", "Closet"),
        ("Salle de bain", "Bathroom"),
        ("WC 2", "Bathroom"),
        ("Küche", "Kitchen"),
        ("Esszimmer", "Dining"),
        ("guesswork", None),
        ("Flur", "Hallway"),
        ("LivingRoom", "Living"),
        ("Pool", None),
        ("", None),
    ],
)
def test_names_of_rooms_mean_types(name: str, expected: str | None) -> None:
    assert room_type(name) == expected


def test_a_title_names_a_room_where_no_label_does() -> None:
    drawing = read_svg(
        b'<svg xmlns="http://www.w3.org/2000/svg"><rect class="room" id="rect1" width="9" height="9">'
        b"<title>Bath</title></rect></svg>",
        "flat.svg",
    )
    assert [shape.name for shape in drawing.shapes] == ["Bath"]


@pytest.mark.parametrize("named", ['data-name="Bath"', 'ifc:name="Bath"', 'inkscape:label="Bath"'])
def test_the_name_of_a_group_with_one_shape_is_the_shapes(named: str) -> None:
    spaces = 'xmlns:ifc="http://www.ifcopenshell.org/ns" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
    text = (
        f'<svg xmlns="http://www.w3.org/2000/svg" {spaces}><g class="IfcSpace" {named}><rect width="9" height="9"/></g>'
        '<g class="room" inkscape:label="Rooms"><rect width="9" height="9"/></g></svg>'
    )
    assert [shape.name for shape in read_svg(text.encode(), "flat.svg").shapes] == ["Bath", ""]


def test_what_ifc_calls_by_the_name_of_a_room_is_none() -> None:
    text = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:ifc="http://www.ifcopenshell.org/ns">
      <g class="IfcBuildingStorey" ifc:name="Guest house">
        <g class="IfcFurnishingElement" ifc:name="Bed"><rect width="2" height="2"/></g>
        <g class="IfcBuildingElementProxy" ifc:name="Kitchen block"><rect width="2" height="2"/></g>
        <g class="IfcSpace" ifc:name="Zone 7"><rect width="9" height="9"/></g>
        <rect width="1" height="1"/>
      </g></svg>"""
    drawing = read_svg(text.encode(), "flat.svg")
    assert [kind_of(shape, drawing.labels) for shape in drawing.shapes] == ["other", "other", "room", None]
    notes = DrawingNotes.model_validate({"rooms": {"Zone 7": {"type": "Bedroom"}}})
    plan, left_out = read_plan(drawing, 1.0, notes, "flat.svg")
    assert [(room.name, room.type) for room in plan.rooms] == [("Zone 7", "Bedroom")]
    assert left_out == [
        '1 <rect> in "IfcFurnishingElement": "Bed"',
        '1 <rect> in "IfcBuildingElementProxy": "Kitchen block"',
        '1 <rect> in "IfcBuildingStorey"',
    ]


def test_all_that_is_left_out_is_counted() -> None:
    text = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:x="urn:other">
      <defs><circle id="c" r="2"/></defs><metadata/><style/><x:view/><!-- a comment -->
      <circle r="3"/><g class="Plants"><circle r="3"/><circle r="4" id="palm"/><ellipse rx="1"/></g><use href="#c"/>
      <image href="a.png"/><foreignObject/><rect id="Kitchen" width="9" height="9"/><path d="M0 0"/><wibble/>
      <path class="Bath" d="M0 20h9v9h-9z m2 2h1v1z m2 2h1v1z"/><g style="display : none"><rect/></g>
      <text x="1" y="1">north</text><text x="1" y="50">12 m2</text><text x="1" y="21">Bad</text><text/>
      <use href="plan.svg#door"/><use href="#gone"/><polyline points="0,0 1,1 2,0"/>
      <polyline points="1,0 1,1"/></svg>"""
    drawing = read_svg(text.encode(), "flat.svg")
    assert drawing.left_out == [
        "2 <circle>",
        '2 <circle> in "Plants"',
        '1 <ellipse> in "Plants"',
        "1 <image>",
        "1 <foreignObject>",
        "1 <path> without any extent",
        "1 <wibble>",
        '2 further parts of <path> in "Bath"',
        "1 hidden <g>",
        '1 <use> of "plan.svg#door", which is outside of the drawing',
        '1 <use> of "#gone", which the drawing does not have',
    ]
    _, left_out = read_plan(drawing, 1.0, DrawingNotes(), "flat.svg")
    assert left_out == ["2 <polyline>", '2 texts: "north", "12 m2"']


def test_a_list_of_what_is_left_out_has_an_end() -> None:
    shapes = "".join(f'<circle class="c{number}"/>' for number in range(50))
    left_out = read_svg(f'<svg xmlns="http://www.w3.org/2000/svg">{shapes}</svg>'.encode(), "flat.svg").left_out
    assert (len(left_out), left_out[-1]) == (41, "10 of 10 more kinds")


def test_what_is_invisible_is_left_out_with_all_in_it_that_says_nothing_else() -> None:
    text = """<svg xmlns="http://www.w3.org/2000/svg"><rect id="Bath" visibility="hidden" width="9" height="9"/>
      <rect id="Hall" style="fill:red; visibility : collapse" width="9" height="9"/>
      <g class="room" visibility="hidden"><rect width="9" height="9"/><text x="1" y="1">Flur</text>
      <rect id="Kitchen" visibility="visible" width="9" height="9"/></g></svg>"""
    drawing = read_svg(text.encode(), "flat.svg")
    assert ([shape.name for shape in drawing.shapes], drawing.labels) == (["Kitchen"], [])
    assert drawing.left_out == ["2 hidden <rect>", '1 hidden <rect> in "room"', '1 hidden <text> in "room"']
