"""The drawn plan: valid, self-contained, to scale, safe with any name."""

import json
import re
from math import pi
from typing import Any
from xml.etree import ElementTree

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.worlds.world import MODEL_TYPES, Floorplan, Furniture, World
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.pictures.plan_svg import floorplan_svg, place_label, widest_box
from prefect_robomaker.tasks.worldforge.pictures.plan_symbols import number, symbol

SVG = "{http://www.w3.org/2000/svg}"


def plan(seed: int = 0, rooms: tuple[tuple[str, float], ...] = (("Living", 26), ("Kitchen", 12))) -> Floorplan:
    shapes = [
        {"Type": kind, "Name": kind, "DesiredShape": {"Area": area, "AspectRatio": {"x": 1, "y": 1}}}
        for kind, area in rooms
    ]
    links = [{"Location": [rooms[0][0], rooms[1][0]], "ConnectionType": "Opening"}]
    body = json.dumps({"Buildings": [{"Floors": [{"Floorplan": {"Rooms": shapes, "DesiredConnections": links}}]}]})
    return generate_floorplan(parse_template_body(body), seed)


def world(floorplan: Floorplan, furniture: list[Furniture] | None = None) -> World:
    return World(
        generator_version="1",
        floorplan_seed=0,
        interior_seed=0,
        floorplan=floorplan,
        furniture=furniture or [],
        wishes=[],
    )


def renamed(floorplan: Floorplan, name: str) -> Floorplan:
    rooms = [floorplan.rooms[0].model_copy(update={"name": name}), *floorplan.rooms[1:]]
    return floorplan.model_copy(update={"rooms": rooms})


def desk(model_type: str = "Desks", **changes: float) -> Furniture:
    sizes: dict[str, Any] = {
        "x": 1.0,
        "y": 0.5,
        "yaw": pi / 2,
        "width_m": 1.4,
        "depth_m": 0.7,
        "height_m": 0.7,
    } | changes
    return Furniture(id="piece", model_type=model_type, room="Living", **sizes)


def parsed(drawing: str) -> ElementTree.Element:
    return ElementTree.fromstring(drawing)


def group(root: ElementTree.Element, name: str) -> ElementTree.Element:
    found = root.find(f".//{SVG}g[@id='{name}']")
    assert found is not None
    return found


def test_the_overlay_is_the_empty_last_child_of_the_group_in_metres() -> None:
    metres = group(parsed(floorplan_svg(world(plan()))), "world")
    assert metres[-1].get("id") == "overlay"
    assert len(metres[-1]) == 0


def test_the_published_scale_puts_the_outline_inside_the_page_with_north_up() -> None:
    floorplan = plan(3)
    root = parsed(floorplan_svg(world(floorplan)))
    scale, origin_x, origin_y = (float(root.attrib[f"data-{key}"]) for key in ("scale", "origin-x", "origin-y"))
    _, _, width, height = map(float, root.attrib["viewBox"].split())
    assert group(root, "world").get("transform") == f"translate({origin_x:g} {origin_y:g}) scale({scale:g} {-scale:g})"
    pixels = [(origin_x + scale * x, origin_y - scale * y) for x, y in floorplan.footprint]
    assert all(0 < x < width and 0 < y < height for x, y in pixels)
    _, north = max(zip(floorplan.footprint, pixels, strict=True), key=lambda both: both[0][1])
    assert north[1] == min(y for _, y in pixels), "the northern corner lies highest on the page"


def test_every_part_of_the_world_is_drawn() -> None:
    floorplan = plan(1)
    drawing = floorplan_svg(world(floorplan, [desk(), desk("Mug", yaw=0)]))
    assert drawing.count('class="fp-wall"') == sum(not wall.lintel for wall in floorplan.walls)
    assert drawing.count('class="fp-threshold"') == sum(wall.lintel for wall in floorplan.walls)
    assert drawing.count('class="fp-window"') == len(floorplan.windows)
    assert drawing.count('class="fp-opening"') == 1
    assert 'class="fp-furniture" transform="translate(1 0.5) rotate(90)"' in drawing
    for room in floorplan.rooms:
        assert f">{room.name}</text>" in drawing
        assert f">{room.floor_m2:.1f} m²</text>" in drawing


def test_it_is_readable_in_light_and_dark_and_loads_nothing() -> None:
    drawing = floorplan_svg(world(plan()))
    assert "prefers-color-scheme:dark" in drawing
    assert not re.search(r"(href|src|url\(|@import|<script)", drawing)


@examples(60)
@given(st.text(max_size=40))
def test_any_name_comes_out_as_text(name: str) -> None:
    root = parsed(floorplan_svg(world(renamed(PLAN, name))))
    tags = {element.tag.removeprefix(SVG) for element in root.iter()}
    assert tags <= {"svg", "style", "rect", "path", "text", "g", "title"}


PLAN = plan()


@pytest.mark.parametrize("name", ["</text><script>alert(1)</script>", '"><svg onload="x', "a & b", "\x00\x1b\ufffe"])
def test_hostile_names_are_escaped(name: str) -> None:
    drawing = floorplan_svg(world(renamed(PLAN, name), [desk(name)]))
    root = parsed(drawing)
    assert "<script" not in drawing
    assert "onload=" not in re.sub(r"&quot;&gt;&lt;svg onload=&quot;x", "", drawing)
    titles = [title.text for title in root.iter(f"{SVG}title")]
    assert name.strip("\x00\x1b\ufffe") in {title or "" for title in titles}


def test_names_of_all_printable_characters_are_drawn() -> None:
    name = "".join(filter(str.isprintable, map(chr, range(0x110000))))
    root = parsed(floorplan_svg(world(renamed(PLAN, name))))
    assert any(name in (title.text or "") for title in root.iter(f"{SVG}title"))


def test_a_long_name_is_cut_to_the_room_and_kept_whole_in_the_title() -> None:
    name = "N" * 255
    room = renamed(PLAN, name).rooms[0]
    label = place_label(room, [], 50)
    west, south, east, north = widest_box(room)
    assert len(label.name) * 8 < max(east - west, north - south) * 50
    assert label.name.endswith("…")
    assert f"<title>{name}</title>" in floorplan_svg(world(renamed(PLAN, name)))


def test_labels_lie_inside_bent_rooms() -> None:
    around_closet = [(3.3, 0.0), (17.0, 0.0), (17.0, 17.0), (0.0, 17.0), (0.0, 3.3), (3.3, 3.3)]
    hall = PLAN.rooms[0].model_copy(update={"polygon": around_closet, "area_m2": 17.0**2 - 3.3**2})
    label = place_label(hall, [], 50)
    west, south, east, north = widest_box(hall)
    assert west < label.x < east
    assert south < label.y < north
    assert not (label.x < 3.3 and label.y < 3.3)
    assert (east - west) * (north - south) > 0.75 * hall.area_m2


def test_labels_keep_off_furniture_and_the_origin() -> None:
    room = PLAN.rooms[0]
    first = place_label(room, [], 60)
    blocked = desk(x=first.x, y=first.y, width_m=1.0, depth_m=1.0)
    second = place_label(room, [blocked], 60)
    assert abs(second.x - first.x) > 0.4 or abs(second.y - first.y) > 0.4
    assert max(abs(first.x), abs(first.y)) > 0.3


@pytest.mark.parametrize("model_type", [*MODEL_TYPES, "SomethingNew"])
@pytest.mark.parametrize(("depth", "width"), [(0.6, 1.8), (2.0, 0.9), (0.2, 0.2)])
def test_symbols_stay_within_the_footprint(model_type: str, depth: float, width: float) -> None:
    root = ElementTree.fromstring(f"<g>{symbol(model_type, depth, width)}</g>")
    assert len(root) >= 1
    for part in root:
        value = {key: float(text) for key, text in part.attrib.items()}
        if part.tag == "rect":
            xs, ys = [value["x"], value["x"] + value["width"]], [value["y"], value["y"] + value["height"]]
        elif part.tag == "ellipse":
            xs = [value["cx"] - value["rx"], value["cx"] + value["rx"]]
            ys = [value["cy"] - value["ry"], value["cy"] + value["ry"]]
        else:
            xs, ys = [value["x1"], value["x2"]], [value["y1"], value["y2"]]
        # A tap or a door grip may stick out by a finger's breadth.
        assert max(map(abs, xs)) <= depth / 2 + 0.03
        assert max(map(abs, ys)) <= width / 2 + 0.03
        assert all(value[key] > 0 for key in ("width", "height", "rx", "ry") if key in value)


@pytest.mark.parametrize(
    ("value", "text"), [(1.0, "1"), (-0.0, "0"), (1e-9, "0"), (-1e-9, "0"), (0.1 + 0.2, "0.3"), (-12.3456, "-12.346")]
)
def test_numbers_are_short_and_never_in_exponents(value: float, text: str) -> None:
    assert number(value) == text


def test_the_same_world_gives_the_same_drawing() -> None:
    assert floorplan_svg(world(plan(5), [desk()])) == floorplan_svg(world(plan(5), [desk()]))


def test_a_room_is_called_what_its_user_called_it(flat: World) -> None:
    rooms = [
        room.model_copy(update={"name": "Kuche", "original_name": "Küche"}) if room.name == "Kitchen" else room
        for room in flat.floorplan.rooms
    ]
    plan = flat.floorplan.model_copy(update={"rooms": rooms})
    assert ">Küche<" in floorplan_svg(flat.model_copy(update={"floorplan": plan}))
