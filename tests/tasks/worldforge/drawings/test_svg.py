"""SVG files as programs write them: transforms, paths, sizes on paper, names and layers."""

import pytest

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.tasks.worldforge.drawings.drawn_shapes import kind_of, room_type
from prefect_robomaker.tasks.worldforge.drawings.room_finding import metres_per_unit, read_plan
from prefect_robomaker.tasks.worldforge.drawings.svg import PathError, path_points, read_svg

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


def test_paths_in_all_ways_of_writing() -> None:
    square = [(0, 0), (4, 0), (4, 3), (0, 3)]
    assert path_points("M0 0H4V3H0Z") == (square, True, False)
    assert path_points("m0,0 4,0 0,3 -4,0z") == (square, True, False)
    assert path_points("M 0 0 L 4 0 4 3 0 3 0 0") == ([*square, (0, 0)], True, False)
    assert path_points("M0 0 A4 4 0 0 1 4 4") == ([(0, 0), (4, 4)], False, True)
    assert path_points("M0 0H4V3H0Z M1 1h1v1z")[0] == square, "the first part alone"
    with pytest.raises(PathError, match="begin with M"):
        path_points("4 0 L 4 3")


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
