"""Floor plans: what holds for every template, and what a few particular ones become."""

import json
from collections import Counter
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.specs.checking.impossible_goals import start_room
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.wire.errors import WorldGenerationError
from prefect_robomaker.schemas.worlds.world import INDOOR_ROOM_TYPES, Floorplan, Point, contains
from prefect_robomaker.tasks.worldforge.floorplans import partition_climb
from prefect_robomaker.tasks.worldforge.floorplans.brief import MIN_SIDES_M
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.floorplans.partition_costs import BatchEvaluator, Cuts, Nature

UNIT = 0.05


def room(name: str, kind: str, area: float = 20, ratio: tuple[float, float] = (1, 1)) -> dict[str, Any]:
    shape = {"Area": area, "AspectRatio": {"x": ratio[0], "y": ratio[1]}}
    return {"Type": kind, "Name": name, "DesiredShape": shape}


def template(
    rooms: list[dict[str, Any]],
    connections: list[tuple[str, str, str]] | None = None,
    footprint: tuple[float, float] = (1, 1),
    height: float = 3.0,
) -> WorldTemplateBody:
    floorplan = {
        "Footprint": {"DesiredAspectRatio": {"x": footprint[0], "y": footprint[1]}},
        "Ceiling": {"Height": height},
        "Rooms": rooms,
        "DesiredConnections": [
            {"Location": [one, other], "ConnectionType": kind} for one, other, kind in connections or []
        ],
    }
    return parse_template_body(json.dumps({"Buildings": [{"Floors": [{"Floorplan": floorplan}]}]}))


FLAT = template(
    [
        room("Living", "Living", 26, (3, 2)),
        room("Kitchen", "Kitchen", 12),
        room("Bedroom", "Bedroom", 16),
        room("Bath", "Bathroom", 10),
    ],
    [("Living", "Kitchen", "Opening"), ("Living", "Bedroom", "Doorway"), ("Bedroom", "Bath", "Doorway")],
    (4, 3),
)

sides = st.floats(1, 4)


@st.composite
def templates(draw: st.DrawFn) -> WorldTemplateBody:
    """Any body that the parser accepts."""
    count = draw(st.integers(1, 6))
    rooms = [
        room(str(index), draw(st.sampled_from(INDOOR_ROOM_TYPES)), draw(st.floats(10, 300)), (draw(sides), draw(sides)))
        for index in range(count)
    ]
    connections: list[tuple[str, str, str]] = []
    degrees: Counter[str] = Counter()
    kinds: dict[frozenset[str], str] = {}
    for _ in range(draw(st.integers(0, 12)) if count > 1 else 0):
        one, other = draw(st.lists(st.integers(0, count - 1).map(str), min_size=2, max_size=2, unique=True))
        pair = frozenset((one, other))
        kind = draw(st.sampled_from(["Doorway", "Opening"]))
        if max(degrees[one], degrees[other]) < 4 and (pair not in kinds or kind == kinds[pair] == "Doorway"):
            connections.append((one, other, kind))
            degrees.update(pair)
            kinds[pair] = kind
    return template(rooms, connections, (draw(sides), draw(sides)), draw(st.floats(2.4, 4.0)))


def generate(body: WorldTemplateBody, seed: int = 0) -> Floorplan:
    return generate_floorplan(body, seed)


class Raster:
    """A plan on cells of 5 cm, drawn with plain loops that share nothing with the generator."""

    def __init__(self, plan: Floorplan) -> None:
        self.plan = plan
        self.west = min(x for x, _ in plan.footprint) - 0.5
        self.south = min(y for _, y in plan.footprint) - 0.5
        columns = round((max(x for x, _ in plan.footprint) + 0.5 - self.west) / UNIT)
        rows = round((max(y for _, y in plan.footprint) + 0.5 - self.south) / UNIT)
        self.shape = (rows, columns)

    def box(self, x0: float, y0: float, x1: float, y1: float) -> tuple[slice, slice]:
        columns = [(x - self.west) / UNIT for x in (x0, x1)]
        rows = [(y - self.south) / UNIT for y in (y0, y1)]
        for value in (*columns, *rows):
            assert value == pytest.approx(round(value), abs=1e-6), "a face off the 5 cm lattice"
        return slice(round(rows[0]), round(rows[1])), slice(round(columns[0]), round(columns[1]))

    def band(self, start: Point, end: Point, thickness: float) -> tuple[slice, slice]:
        """The rectangle along an axis-aligned line; nothing is added at the ends."""
        (x0, y0), (x1, y1) = start, end
        half = thickness / 2
        return self.box(x0, y0 - half, x1, y1 + half) if y0 == y1 else self.box(x0 - half, y0, x1 + half, y1)

    def wall_count(self) -> np.ndarray:
        count = np.zeros(self.shape, int)
        for wall in self.plan.walls:
            if not wall.lintel:
                count[self.band(wall.start, wall.end, wall.thickness_m)] += 1
        return count

    def rooms(self) -> np.ndarray:
        """How many rooms each cell belongs to."""
        return sum((self.room(index) for index in range(len(self.plan.rooms))), np.zeros(self.shape, int))

    def room(self, index: int) -> np.ndarray:
        """1 inside a room."""
        return self.inside(self.plan.rooms[index].polygon)

    def inside(self, polygon: list[Point]) -> np.ndarray:
        """1 inside a polygon, by the sum of signed strips under its horizontal edges."""
        cells = np.zeros(self.shape, int)
        bottom = min(y for _, y in polygon)
        for (x0, y0), (x1, y1) in pairwise([*polygon, polygon[0]]):
            if y0 == y1 and y0 != bottom:
                cells[self.box(min(x0, x1), bottom, max(x0, x1), y0)] += 1 if x1 < x0 else -1
        return cells


@examples(30)
@given(templates(), st.integers(0, 2**32 - 1))
def test_every_plan_keeps_what_plans_promise(body: WorldTemplateBody, seed: int) -> None:
    plan = generate(body, seed)
    raster = Raster(plan)
    rooms_tile_the_footprint(body, plan, raster)
    walls_meet_without_overlap_and_without_gap(plan, raster)
    every_room_is_connected_wide_enough_and_the_origin_is_clear(plan, raster)
    robots_start_where_the_template_says(body, plan)
    doorways_keep_their_width_and_their_distance_from_corners(plan, raster)
    wishes_are_accounted_for_one_by_one_and_truly(body, plan)
    windows_lie_on_outer_walls_of_rooms_that_want_light(plan)


def rooms_tile_the_footprint(body: WorldTemplateBody, plan: Floorplan, raster: Raster) -> None:
    assert (raster.rooms() == raster.inside(plan.footprint)).all()
    for index, item in enumerate(plan.rooms):
        cells = raster.room(index)
        assert cells.sum() * UNIT**2 == pytest.approx(item.area_m2)
        for start, end in pairwise([*item.polygon, item.polygon[0]]):
            first, last = sorted((start, end))
            cells[raster.band(first, last, 0.1)] = 0
            for corner in (start, end):
                cells[raster.box(corner[0] - UNIT, corner[1] - UNIT, corner[0] + UNIT, corner[1] + UNIT)] = 0
        for band in outer_walls(plan, raster):
            cells[band] = 0
        assert cells.sum() * UNIT**2 == pytest.approx(item.floor_area_m2)
    assert [item.name for item in plan.rooms] == [item.Name for item in body.floorplan.Rooms]


def outer_walls(plan: Floorplan, raster: Raster) -> list[tuple[slice, slice]]:
    """Bands of 20 cm along the outline, each with the squares at its ends."""
    bands: list[tuple[slice, slice]] = []
    for start, end in pairwise([*plan.footprint, plan.footprint[0]]):
        (x0, y0), (x1, y1) = sorted((start, end))
        bands.append(raster.box(x0 - 0.1, y0 - 0.1, x1 + 0.1, y1 + 0.1))
    return bands


def walls_meet_without_overlap_and_without_gap(plan: Floorplan, raster: Raster) -> None:
    expected = np.zeros(raster.shape, bool)
    for item in plan.rooms:
        for start, end in pairwise([*item.polygon, item.polygon[0]]):
            low, high = sorted((start, end))
            expected[raster.band(low, high, 0.1)] = True
            for x, y in (start, end):
                expected[raster.box(x - UNIT, y - UNIT, x + UNIT, y + UNIT)] = True
    for band in outer_walls(plan, raster):
        expected[band] = True
    for passage in plan.passages:
        expected[raster.band(passage.start, passage.end, 0.1)] = False
    assert (raster.wall_count() == expected).all()


def every_room_is_connected_wide_enough_and_the_origin_is_clear(plan: Floorplan, raster: Raster) -> None:
    reached = {plan.rooms[0].name}
    for _ in plan.rooms:
        reached |= {name for passage in plan.passages if reached & {*passage.rooms} for name in passage.rooms}
    assert reached == {item.name for item in plan.rooms}
    for index, item in enumerate(plan.rooms):
        assert narrowest(raster.room(index)) * UNIT >= MIN_SIDES_M[item.type] - 1e-9
    rows, columns = np.nonzero(raster.wall_count())
    x, y = raster.west + (columns + 0.5) * UNIT, raster.south + (rows + 0.5) * UNIT
    assert np.hypot(x, y).min() > 0.5
    column, row = round(-raster.west / UNIT), round(-raster.south / UNIT)
    assert raster.rooms()[row, column] == 1


def robots_start_where_the_template_says(body: WorldTemplateBody, plan: Floorplan) -> None:
    if (start := start_room(body.floorplan.Rooms)) is not None:
        assert [item.name for item in plan.rooms if contains(item.polygon, 0.0, 0.0)] == [start]


def narrowest(cells: np.ndarray) -> int:
    """The shortest run of ones in any row or column: no part of the room is narrower."""
    shortest = min(cells.shape)
    for lines in (cells, cells.T):
        for line in lines[lines.any(axis=1)]:
            edges = np.flatnonzero(np.diff(np.concatenate([[0], line, [0]])))
            shortest = min(shortest, int((edges[1::2] - edges[::2]).min()))
    return shortest


def doorways_keep_their_width_and_their_distance_from_corners(plan: Floorplan, raster: Raster) -> None:
    walls = raster.wall_count() > 0
    lintels = [wall for wall in plan.walls if wall.lintel]
    doorways = [passage for passage in plan.passages if passage.kind == "Doorway"]
    assert len(lintels) == len(doorways)
    for doorway in doorways:
        assert doorway.width_m == 0.9
        assert (doorway.start, doorway.end) in [(wall.start, wall.end) for wall in lintels]
        rows, columns = raster.band(doorway.start, doorway.end, 0.1)
        horizontal = doorway.start[1] == doorway.end[1]
        along = columns if horizontal else rows
        for piece in (slice(along.start - 6, along.start), slice(along.stop, along.stop + 6)):
            beside = (rows, piece) if horizontal else (piece, columns)
            assert walls[beside].all(), "less than 0.3 m of wall beside a doorway"
    for passage in plan.passages:
        assert not walls[raster.band(passage.start, passage.end, 0.1)].any()
        assert passage.width_m >= 0.9


def wishes_are_accounted_for_one_by_one_and_truly(body: WorldTemplateBody, plan: Floorplan) -> None:
    outcomes = {wish.path.removeprefix("Buildings[0].Floors[0].Floorplan."): wish for wish in plan.wishes}
    rooms, connections = body.floorplan.Rooms, body.floorplan.DesiredConnections
    assert len(plan.wishes) == len(outcomes) == 2 + 2 * len(rooms) + len(connections)
    for wish in plan.wishes:
        assert bool(wish.reason) == (wish.outcome != "satisfied")
    for index, item in enumerate(plan.rooms):
        off = abs(item.floor_m2 / item.desired_area_m2 - 1)
        assert (outcomes[f"Rooms[{index}].DesiredShape.Area"].outcome == "satisfied") == (off <= 0.05)
    granted = Counter((frozenset(p.rooms), p.kind) for p in plan.passages if p.requested)
    claimed = Counter(
        (frozenset(connection.Location), connection.ConnectionType)
        for index, connection in enumerate(connections)
        if outcomes[f"DesiredConnections[{index}]"].outcome == "satisfied"
    )
    assert granted == claimed


def test_a_default_is_no_wish_that_can_be_missed() -> None:
    """A missed 1:1 that the template never had would send people after a fault that is none."""
    open_rooms = [
        room("Living", "Living", 24, (3, 2)),
        room("Bed", "Bedroom", 14),
        {"Type": "Bathroom", "Name": "Bath"},
    ]
    open_rooms[1]["DesiredShape"]["AspectRatio"] = {}
    whole_rooms = [open_rooms[0], room("Bed", "Bedroom", 14), room("Bath", "Bathroom", 20)]
    unstated = parse_template_body(json.dumps({"Buildings": [{"Floors": [{"Floorplan": {"Rooms": open_rooms}}]}]}))
    dropped: set[str] = set()
    for seed in range(8):
        plan, whole = generate(unstated, seed), generate(template(whole_rooms), seed)
        assert plan.model_copy(update={"wishes": whole.wishes}) == whole, "a default is still what plans aim at"
        gone = [wish for wish in whole.wishes if wish not in plan.wishes]
        assert plan.wishes == [wish for wish in whole.wishes if wish not in gone]
        assert all(wish.outcome != "satisfied" for wish in gone)
        dropped |= {wish.path.partition("Floorplan.")[2] for wish in gone}
        assert all("Rooms[0]" in wish.path for wish in plan.wishes if wish.outcome != "satisfied")
    assert dropped == {"Footprint.DesiredAspectRatio", "Rooms[1].DesiredShape.AspectRatio"}


def test_the_outline_of_a_single_room_contradicts_no_default() -> None:
    hall = {"Rooms": [room("Hall", "Living", 32, (2, 1))]}
    plan = generate(parse_template_body(json.dumps({"Buildings": [{"Floors": [{"Floorplan": hall}]}]})))
    assert [wish.wish for wish in plan.wishes] == [
        "ceiling 3 m above the floor", "Hall of 32 m2", "Hall with aspect ratio 2:1",
    ]  # fmt: skip


def windows_lie_on_outer_walls_of_rooms_that_want_light(plan: Floorplan) -> None:
    types = {item.name: item.type for item in plan.rooms}
    outer = [wall for wall in plan.walls if wall.exterior]
    for window in plan.windows:
        assert types[window.room] in {"Bedroom", "Dining", "Kitchen", "Living", "Office"}
        assert any(
            wall.rooms == [window.room] and covers((wall.start, wall.end), window.start, window.end) for wall in outer
        )


def covers(line: tuple[Point, Point], start: Point, end: Point) -> bool:
    (x0, y0), (x1, y1) = line
    return all(min(x0, x1) <= x <= max(x0, x1) and min(y0, y1) <= y <= max(y0, y1) for x, y in (start, end))


def test_the_same_generator_state_gives_the_same_bytes() -> None:
    assert generate(FLAT, 7).model_dump_json() == generate(FLAT, 7).model_dump_json()


def test_other_seeds_give_really_other_plans() -> None:
    plans = [generate(FLAT, seed) for seed in range(30)]
    dimensions = {tuple(sorted(item.area_m2 for item in plan.rooms)) + tuple(map(shape, plan.rooms)) for plan in plans}
    assert len(dimensions) >= 4, "the rooms' shapes hardly vary"
    assert len({plan.model_dump_json() for plan in plans}) == 30


def shape(item: Any) -> tuple[float, float]:
    xs, ys = zip(*item.polygon, strict=True)
    return round(max(xs) - min(xs), 2), round(max(ys) - min(ys), 2)


def test_a_reasonable_flat_gets_its_areas_its_connections_and_its_footprint() -> None:
    for seed in range(20):
        plan = generate(FLAT, seed)
        missed = [wish.wish for wish in plan.wishes if wish.outcome != "satisfied" and "aspect ratio" not in wish.wish]
        assert missed == []
        for item in plan.rooms:
            width, height = shape(item)
            assert max(width, height) / min(width, height) < 4


def test_one_room_takes_its_own_shape_and_says_that_the_footprint_contradicts() -> None:
    plan = generate(template([room("Hall", "Living", 32, (2, 1))]))
    assert sorted(shape(plan.rooms[0])) == [4.2, 8.2]
    assert plan.rooms[0].floor_area_m2 == 32.0
    assert plan.rooms[0].aspect_ratio == 2.0
    assert [wish.outcome for wish in plan.wishes if "footprint" in wish.wish] == ["contradictory"]
    assert plan.passages == []


def test_a_small_closet_beside_a_hall_is_no_sliver() -> None:
    plan = generate(template([room("Hall", "Living", 300), room("Closet", "Closet", 10)]))
    assert shape(plan.rooms[1]) == (pytest.approx(3.35, abs=0.25), pytest.approx(3.35, abs=0.25))
    assert [wish.wish for wish in plan.wishes if wish.outcome != "satisfied"] == []


def test_several_doorways_join_one_pair_when_asked_for() -> None:
    body = template([room("A", "Living", 60), room("B", "Dining", 60)], [("A", "B", "Doorway")] * 4)
    plan = generate(body)
    assert [passage.kind for passage in plan.passages] == ["Doorway"] * 4
    assert all(wish.outcome == "satisfied" for wish in plan.wishes if "Doorway" in wish.wish)


def test_doorways_that_do_not_fit_are_reported_with_numbers() -> None:
    body = template([room("A", "Closet", 10, (4, 1)), room("B", "Closet", 10, (4, 1))], [("A", "B", "Doorway")] * 4)
    outcomes: Counter[str] = Counter()
    for seed in range(10):
        plan = generate(body, seed)
        wishes = [wish for wish in plan.wishes if "Doorway" in wish.wish]
        outcomes.update(wish.outcome for wish in wishes)
        assert all("m has no room" in wish.reason for wish in wishes if wish.outcome == "missed")
        assert sum(wish.outcome == "satisfied" for wish in wishes) == len(plan.passages)
    assert outcomes["satisfied"]


def test_four_rooms_that_should_all_touch_each_other_are_a_contradiction() -> None:
    names = ["A", "B", "C", "D"]
    pairs = [(one, other, "Doorway") for index, one in enumerate(names) for other in names[index + 1 :]]
    plan = generate(template([room(name, "Living", 20) for name in names], pairs))
    refused = [wish for wish in plan.wishes if wish.outcome == "contradictory" and "Doorway" in wish.wish]
    assert refused
    assert refused[0].reason.startswith("no plan of rectangular rooms has these 6 ways together")
    assert refused[0].reason.endswith("A - B, A - C, A - D, B - C, B - D, C - D")


def test_twelve_connections_among_six_rooms_are_a_contradiction_of_all_twelve() -> None:
    names = "ABCDEF"
    opposite = {("A", "B"), ("C", "D"), ("E", "F")}
    pairs = [(one, other, "Doorway") for one, other in combinations(names, 2) if (one, other) not in opposite]
    plan = generate(template([room(name, "Living", 20) for name in names], pairs))
    refused = [wish for wish in plan.wishes if wish.outcome == "contradictory" and "Doorway" in wish.wish]
    assert refused
    assert "these 12 ways together, while without any one of them" in refused[0].reason


def test_a_room_too_small_for_its_aspect_ratio_says_so() -> None:
    plan = generate(template([room("Strip", "Bedroom", 10, (4, 1)), room("Hall", "Living", 40)]))
    reason = next(wish.reason for wish in plan.wishes if wish.wish.startswith("Strip with aspect"))
    assert reason == (
        "at 10 m2 its floor would be 1.58 m wide, and between the middles of its walls a room of this type is at least "
        "2.2 m"
    )


def test_an_opening_takes_the_wall_away_from_corner_to_corner() -> None:
    plan = generate(template([room("A", "Living", 20), room("B", "Dining", 20)], [("A", "B", "Opening")]))
    (opening,) = plan.passages
    assert opening.kind == "Opening"
    assert opening.width_m == pytest.approx(
        min(shape(plan.rooms[0])[i] for i in (0, 1) if opening.start[i] != opening.end[i]) - 0.2
    )
    assert not any(not wall.exterior for wall in plan.walls)


def test_baths_and_closets_are_not_passed_through_unless_asked_for() -> None:
    body = template(
        [
            room("Hallway", "Hallway", 14, (3, 1)),
            room("Living", "Living", 28),
            room("Bedroom", "Bedroom", 16),
            room("Bath", "Bathroom", 10),
            room("Closet", "Closet", 10),
        ],
        footprint=(4, 3),
    )
    through = 0
    for seed in range(20):
        degrees = Counter(name for passage in generate(body, seed).passages for name in passage.rooms)
        through += (degrees["Bath"] > 1) + (degrees["Closet"] > 1)
    assert through <= 2


def test_the_ceiling_is_as_wished() -> None:
    plan = generate(template([room("A", "Living")], height=2.75))
    assert plan.ceiling_height_m == 2.75


def test_giving_up_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BatchEvaluator, "evaluate", nothing_is_valid)
    monkeypatch.setattr(partition_climb, "MAX_CLIMBS", 0)
    with pytest.raises(WorldGenerationError, match="no partition of 65 m2 into 4 rooms"):
        generate(template([room(name, "Living", 16.25) for name in "ABCD"]))


def nothing_is_valid(evaluator: BatchEvaluator, cuts: Cuts) -> Nature:
    plans = cuts.low.shape[2]
    return Nature(np.zeros(plans), np.zeros(plans, bool), np.zeros((9, plans), bool), np.zeros(plans))
