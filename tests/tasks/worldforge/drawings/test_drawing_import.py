"""Worlds of drawings: what was drawn is what is there, proved like a generated world."""

import hashlib
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.schemas.worlds.world import DrawnSource, World, contains
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import Source, import_world
from prefect_robomaker.tasks.worldforge.geometry.occupancy import occupancy_grid
from prefect_robomaker.tasks.worldforge.proofs.guarantees import proof_lines, violations

FLAT = REPOSITORY / "deployments" / "specs" / "plans" / "flat.svg"

TOUCHING = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 800 500" data-metres-per-unit="0.01">
  <g id="rooms" transform="translate(50 50)">
    <rect id="Wohnzimmer" width="400" height="400"/>
    <polygon id="Küche" points="400,0 700,0 700,200 550,200 550,400 400,400"/>
    <rect id="Schlafzimmer" x="550" y="200" width="150" height="200" class="wide"/>
  </g>
  <g id="doors" transform="translate(50 50)">
    <line x1="400" y1="100" x2="400" y2="190"/>
    <line x1="550" y1="250" x2="550" y2="340"/>
  </g>
</svg>"""


def of(text: str, folder: Path, **notes: object) -> World:
    path = folder / "plan.svg"
    path.write_text(text)
    return import_world(Source(path), DrawingNotes.model_validate(notes), 3, settle=False)


@pytest.fixture(scope="module")
def flat() -> World:
    return import_world(Source(FLAT), DrawingNotes(), 7, settle=False)


def test_rooms_doors_and_windows_are_the_drawn_ones(flat: World) -> None:
    plan = flat.floorplan
    assert [(room.name, room.type) for room in plan.rooms] == [
        ("Living room", "Living"),
        ("Kitchen", "Kitchen"),
        ("Hall", "Hallway"),
        ("Bathroom", "Bathroom"),
        ("Bedroom", "Bedroom"),
        ("Kinderzimmer", "Bedroom"),
    ]
    drawn_m2 = [5.6 * 4.4, 4.1 * 3.0, 1.1 * 2.8 + 5.7 * 1.4, 2.9 * 2.8, 4.4 * 3.6, 3.3 * 3.6]
    assert [room.desired_area_m2 for room in plan.rooms] == pytest.approx(drawn_m2, abs=1e-3)
    assert [room.floor_m2 for room in plan.rooms] == pytest.approx(drawn_m2, rel=0.03)
    opened = {passage.rooms: passage.door and passage.door.open_percent for passage in plan.passages}
    assert opened == {
        ("Living room", "Hall"): 100,
        ("Kitchen", "Hall"): 100,
        ("Hall", "Bathroom"): 0,
        ("Hall", "Bedroom"): 100,
        ("Hall", "Kinderzimmer"): 60,
        ("Living room", "Kitchen"): None,
    }
    assert sorted(window.room for window in plan.windows) == [
        "Bathroom", "Bedroom", "Kinderzimmer", "Kitchen", "Living room",
    ]  # fmt: skip
    assert plan.passages[0].width_m == pytest.approx(0.9)


def test_it_is_proved_and_says_what_is_not_as_drawn(flat: World) -> None:
    assert flat.checks is not None
    assert violations(flat.checks) == []
    assert flat.checks.closed_off_rooms == ["Bathroom"]
    assert "Wishes of the drawing" in [line.name for line in proof_lines(flat)], "no template made it"
    assert {wish.path: wish.reason for wish in flat.floorplan.wishes if wish.outcome != "satisfied"} == {
        "flat.svg#to-bath": "it is 0.85 m wide here, so that 0.8 m stay clear",
        "flat.svg#front": "it leads out of Hall, and worlds end at their outer walls",
    }
    assert isinstance(flat.source, DrawnSource)
    assert flat.source.sha256 == hashlib.sha256(FLAT.read_bytes()).hexdigest()
    assert (flat.source.form, flat.source.metres_per_unit, flat.source.outlines) == ("svg", 1.0, "faces")


def test_north_is_up_and_nothing_is_known_outside_the_outline(flat: World) -> None:
    rooms = {room.name: room for room in flat.floorplan.rooms}
    kitchen, bedroom = rooms["Kitchen"].polygon, rooms["Bedroom"].polygon
    assert min(y for _, y in kitchen) > max(y for _, y in bedroom)
    assert min(x for x, _ in kitchen) > max(x for x, _ in bedroom)

    grid = occupancy_grid(flat.floorplan)
    east, south = max(x for x, _ in flat.floorplan.footprint), min(y for _, y in flat.floorplan.footprint)
    assert not contains(flat.floorplan.footprint, east - 1, south + 1)
    assert not grid.known[grid.cell((east - 1, south + 1))]
    assert grid.free[grid.cell((0.0, 0.0))]
    assert flat.checks is not None
    assert flat.checks.reachable_share > 0.9, "what lies outside does not count as a place to reach"


def test_the_same_drawing_and_seed_give_the_same_world(flat: World) -> None:
    again = import_world(Source(FLAT), DrawingNotes(), 7, settle=False)
    other = import_world(Source(FLAT), DrawingNotes(), 8, settle=False)
    assert again.to_text() == flat.to_text()
    assert other.furniture != flat.furniture
    assert other.floorplan.walls == flat.floorplan.walls


def test_outlines_that_touch_are_the_middles_of_walls(tmp_path: Path) -> None:
    world = of(TOUCHING, tmp_path, rooms={"Schlafzimmer": {"type": "Closet"}})
    living, kitchen, closet = world.floorplan.rooms
    assert (living.type, kitchen.type, closet.type) == ("Living", "Kitchen", "Closet")
    assert (kitchen.name, kitchen.original_name) == ("Kuche", "Küche")
    assert [room.area_m2 for room in (living, kitchen, closet)] == pytest.approx([16, 9, 3])
    assert living.floor_m2 == pytest.approx((4 - 0.15) * (4 - 0.2))
    assert living.desired_area_m2 == pytest.approx(living.floor_m2)
    assert isinstance(world.source, DrawnSource)
    assert world.source.outlines == "centres"
    assert world.floorplan.windows, "a drawing without windows gets those of a generated world"


def test_wishes_for_the_interior_hold_for_drawn_rooms(tmp_path: Path) -> None:
    arrangement = {
        "Name": "bare", "TargetSet": {"RoomNames": ["Wohnzimmer"]}, "SampleSet": {"ModelTypes": ["Sofas"]},
        "DesiredSpatialDensity": "Sparse",
    }  # fmt: skip
    world = of(
        TOUCHING,
        tmp_path,
        ceilingHeight=3.0,
        interior={"Furniture": {"FurnitureArrangements": [arrangement]}},
    )
    living = {item.model_type for item in world.furniture if item.room == "Wohnzimmer" and not item.movable}
    assert living == {"Sofas"}
    assert world.floorplan.ceiling_height_m == 3.0


def test_a_bedroom_without_place_for_a_bed_says_so(tmp_path: Path) -> None:
    """Small, with a door in the middle of each wall."""
    places = {"Bedroom": (3, 3), "Hall": (3, 0), "Living": (0, 3), "Kitchen": (6, 3), "Bathroom": (3, 6)}
    rooms = "".join(f'<rect id="{name}" x="{x}" y="{y}" width="3" height="3"/>' for name, (x, y) in places.items())
    doors = "".join(
        f'<line class="door" id="{x}-{y}" x1="{x}" y1="{y}" x2="{x + across}" y2="{y + 1 - across}"/>'
        for x, y, across in ((4, 3, 1), (4, 6, 1), (3, 4, 0), (6, 4, 0))
    )
    (tmp_path / "cross.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{rooms}{doors}</svg>')
    world = import_world(Source(tmp_path / "cross.svg"), DrawingNotes(), 0, settle=False)
    assert not [item for item in world.furniture if item.model_type == "Beds"]
    [bare] = [wish for wish in world.wishes if wish.wish == "Beds in Bedroom, which is a Bedroom"]
    assert (bare.outcome, bare.path.endswith("Interior.Furniture")) == ("missed", True)
    # The smallest bed is the one that would be needed.
    assert bare.reason.startswith("no wall of Bedroom has 0.98 m free with")


def test_outer_walls_of_a_drawn_balcony_are_railings(tmp_path: Path) -> None:
    world = of(TOUCHING.replace("Schlafzimmer", "Balkon"), tmp_path)
    assert world.checks is not None
    assert violations(world.checks) == []
    plan = world.floorplan
    assert [room.name for room in plan.rooms if room.is_outdoor] == ["Balkon"]
    tops = {(wall.top_m, wall.exterior and wall.rooms == ["Balkon"]) for wall in plan.walls}
    assert tops == {(1.0, True), (None, False)}
    assert all(wall.top_m is None for wall in of(TOUCHING, tmp_path).floorplan.walls)


def test_a_drawing_of_balconies_alone_is_refused(tmp_path: Path) -> None:
    outside = TOUCHING.replace("Wohnzimmer", "Balkon").replace("Küche", "Terrasse").replace("Schlafzimmer", "Loggia")
    with pytest.raises(ConfigurationError, match=r"plan\.svg: only balconies .*Balkon, Terrasse, Loggia.* room inside"):
        of(outside, tmp_path)
