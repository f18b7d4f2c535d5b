"""Doors as programs draw them in SVG: frames, leaves, swings, in groups of one door or of all."""

from pathlib import Path

import pytest

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.schemas.worlds.world import Floorplan
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import planned

ROOMS = """<g class="rooms"><rect id="Living room" x="20" y="20" width="430" height="460"/>
  <rect id="Kitchen" x="460" y="20" width="320" height="260"/>
  <rect id="Bedroom" x="460" y="290" width="320" height="190"/></g>"""
OTHER = '<line class="door" x1="455" y1="350" x2="455" y2="440"/>'
"""The door of the bedroom. That of the kitchen is drawn from (455, 100) to (455, 190)."""

CUBICASA = """<g class="Wall" id="Wall"><polygon points="450,20 460,20 460,480 450,480"/>
  <g id="Door" class="Door Swing Beside"><polygon points="450,100 460,100 460,190 450,190"/>
    <g id="Threshold" class="Threshold"><polygon points="450,100 460,100 460,190 450,190"/></g>
    <g id="Panel" class="Panel Left Positive">
      <g class="PanelArea"><polygon points="360,100 450,100 450,190 360,190"/></g>
      <path d="M450,100 q-90,0 -90,90 l90,0 Z"/></g></g></g>"""

DOORS = {
    "one line": '<g class="door"><line x1="455" y1="100" x2="455" y2="190"/></g>',
    "frame, threshold, field of swing and leaf": CUBICASA,
    "parts in groups of a layer": '<g id="doors"><g id="g12"><path d="M455 100 h90"/>'
    '<path d="M545 100 A90 90 0 0 1 455 190"/></g></g>',
    "leaf drawn shut, and its swing": '<g class="IfcDoor"><path d="M455,100 V190"/>'
    '<path d="M455,100 A90 90 0 0 0 365,190"/></g>',
    "leaf, swing, and posts": '<g class="IfcDoor"><path d="M455,190h-90"/><path d="M455,100 A90 90 0 0 0 365,190"/>'
    '<path d="M450 98h10v4h-10z"/><path d="M450 188h10v4h-10z"/></g>',
    "panel and posts cut": '<g class="IfcDoor"><path d="M450 100h10v4h-10z M450 186h10v4h-10z M453 104h4v82h-4z"/></g>',
    "swing alone": '<path class="door" d="M455,100 A90 90 0 0 0 365,190"/>',
    "swing of a spline": '<path class="door" d="M455,100 C405.3,100 365,140.3 365,190"/>',
    "leaf and swing in one path": '<path class="door" d="M455 190 H365 A90 90 0 0 1 455 100"/>',
    "leaf open beside its threshold": '<g class="door"><path d="M455 100V190"/><path d="M455 190H365"/></g>',
    "two leaves": '<g class="door"><path d="M455 100h45A45 45 0 0 1 455 145"/>'
    '<path d="M455 190h45A45 45 0 0 0 455 145"/></g>',
    "two lines of a sliding door": '<g class="door"><path d="M454.6 100V147"/><path d="M455.4 143V190"/></g>',
    "frame in the wall and leaf open at it": '<g class="door"><rect x="450" y="100" width="10" height="90"/>'
    '<rect x="460" y="100" width="90" height="4"/></g>',
    "the same, the leaf first": '<g class="door"><rect x="460" y="100" width="90" height="4"/>'
    '<rect x="450" y="100" width="10" height="90"/></g>',
    "parts that are called doors, too": '<g id="door-1"><path id="door-1-swing" d="M545 100 A90 90 0 0 1 455 190"/>'
    '<line id="door-1-leaf" x1="455" y1="100" x2="545" y2="100"/></g>',
    "a symbol": '<defs><symbol id="s" class="door" viewBox="-10 0 20 100">'
    '<rect x="-10" width="20" height="100"/></symbol></defs>'
    '<use href="#s" x="446" y="100" width="18" height="90"/>',
}


def plan_of(doors: str, folder: Path, rooms: str = ROOMS) -> Floorplan:
    path = folder / "plan.svg"
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" data-metres-per-unit="0.01">{rooms}{doors}</svg>', encoding="utf-8"
    )
    return planned(path, DrawingNotes(), 0)[2].floorplan


@pytest.mark.parametrize("drawn", DOORS)
def test_a_group_that_draws_a_door_is_that_door(drawn: str, tmp_path: Path) -> None:
    plan = plan_of(DOORS[drawn] + OTHER, tmp_path)
    plain = plan_of(DOORS["one line"] + OTHER, tmp_path)
    assert [(each.rooms, each.start, each.end) for each in plan.passages] == [
        (each.rooms, each.start, each.end) for each in plain.passages
    ]
    assert plain.passages[0].width_m == pytest.approx(0.9)


def test_a_layer_of_doors_has_as_many_as_it_draws(tmp_path: Path) -> None:
    layer = '<g id="doors">' + "".join(
        f'<path d="M455 {y} h90"/><path d="M545 {y} A90 90 0 0 1 455 {y + 90}"/>' for y in (100, 350)
    )
    assert len(plan_of(layer + "</g>", tmp_path).passages) == 2


def test_doors_whose_swings_cross_in_one_layer_are_two(tmp_path: Path) -> None:
    """Their leaves meet: the door of the bedroom opens towards the one of the kitchen."""
    layer = '<g id="doors"><path d="M455 150 h-90 A90 90 0 0 1 455 60"/><path d="M455 300 h-90 A90 90 0 0 0 455 390"/>'
    near = '<path d="M400 140v20"/></g>'
    assert len(plan_of(layer + near, tmp_path).passages) == 2


def test_an_open_leaf_beside_another_wall_is_not_taken_for_the_door(tmp_path: Path) -> None:
    """Hinged 8 cm from the corner: the open leaf stands along the wall between kitchen and bedroom."""
    plan = plan_of('<path class="door" d="M455 272 H545 A90 90 0 0 0 455 182"/>' + OTHER, tmp_path)
    assert [each.rooms for each in plan.passages] == [("Living room", "Kitchen"), ("Living room", "Bedroom")]


def test_a_leaf_that_stands_nearer_to_a_wall_than_its_door_does_is_a_leaf(tmp_path: Path) -> None:
    """Hinged 4 cm from the wall between kitchen and bedroom, and 5 cm from its own."""
    rooms = """<g class="rooms"><rect id="Living room" width="400" height="400"/>
      <rect id="Kitchen" x="400" width="400" height="400"/><rect id="Bedroom" y="400" width="800" height="400"/></g>"""
    door = '<g class="door"><path d="M395 396H305"/><path d="M305 396A90 90 0 0 1 395 306"/></g>'
    way = '<line class="door" x1="200" y1="400" x2="290" y2="400"/>'
    plan = plan_of(door + way, tmp_path, rooms)
    assert [each.rooms for each in plan.passages] == [("Living room", "Kitchen"), ("Living room", "Bedroom")]


def test_of_a_leaf_and_a_line_without_a_swing_the_one_in_a_wall_is_the_door(tmp_path: Path) -> None:
    """The leaf, which is drawn first, stands open 15 cm from the wall between kitchen and bedroom."""
    plan = plan_of('<g class="door"><path d="M455 270H545"/><path d="M455 270V180"/></g>' + OTHER, tmp_path)
    assert [each.rooms for each in plan.passages] == [("Living room", "Kitchen"), ("Living room", "Bedroom")]


def test_windows_of_glass_and_frames_are_one(tmp_path: Path) -> None:
    frame, glass = '<polygon points="100,0 250,0 250,20 100,20"/>', '<line x1="100" y1="10" x2="250" y2="10"/>'
    window = f'<g class="Window Regular">{frame}<g class="Panel">{glass}</g></g>'
    plan = plan_of(DOORS["one line"] + OTHER + window, tmp_path)
    assert [each.room for each in plan.windows] == ["Living room"]
    assert len([wish for wish in plan.wishes if wish.wish.startswith("window")]) == 1
