"""Guarantees of every world: the limits, which of them a world breaks, and their wording.

It needs only the measurements that `world.json` holds; `checks` takes them.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

from ....schemas.wire.common import counted
from ....schemas.worlds.world import (
    GazeboSource,
    Guarantee,
    Passage,
    RoomMeasures,
    StabilityChecks,
    World,
    WorldChecks,
)

MAX_PENETRATION_M = 0.005
MIN_CELLS = 5
MIN_PASSAGE_M = 0.8
MAX_DRIFT_M = 0.01
ORIGIN_RADIUS_M = 0.5
SETTLE_S = 2.0
REST_S = 10.0
"""Simulated time for which bodies of imported worlds have to stay where they are, in seconds."""
MAX_MOVED_M = 0.02
"""Limit of a loose object's movement after a push, in metres."""
MAX_SUNK_M = 0.01
"""Limit of a loose object's sinking after a push, in metres."""
MOST_TOLD = 10
"""Limit of the overlaps that are named in a message."""

Verdict = Literal["holds", "broken", "not measured", "warning", ""]


class ProofLine(NamedTuple):
    """A measurement of a world, as a line for people."""

    name: str
    value: str
    verdict: Verdict
    """Whether a world's guarantee holds; `warning`: it holds, but not as doors stand; empty: it is no guarantee."""


def violations(checks: WorldChecks) -> list[str]:
    """Lists the guarantees that a world breaks, one sentence each; empty for a valid world."""
    faults = checks.faults or []
    placed = {fault.guarantee for fault in faults}
    found: list[str] = []
    for name, cells in checks.reachable_cells.items():
        if cells < MIN_CELLS:
            found.append(f"{name}: a robot of {checks.robot_radius_m} m radius reaches {cells} cells, not {MIN_CELLS}")
    if "reach" not in placed:
        found += [f"{name}: its goal is out of a robot's reach" for name in checks.unreachable_goals]
    if not checks.origin_clear:
        found.append(f"the cylinder of {2 * ORIGIN_RADIUS_M:g} m diameter at the origin is not clear")
    if checks.max_penetration_m > MAX_PENETRATION_M and "overlaps" not in placed:
        parts = f": {' and '.join(checks.penetrating[0])}" if checks.penetrating else ""
        found.append(f"parts overlap by {checks.max_penetration_m} m, more than {MAX_PENETRATION_M} m{parts}")
    narrowest_m = checks.narrowest_passage_m
    if narrowest_m is not None and narrowest_m < MIN_PASSAGE_M and "ways" not in placed:
        found.append(f"a passage is {narrowest_m} m wide, not {MIN_PASSAGE_M} m")
    if unjoined := rooms_apart(checks):
        found.append(f"no way between rooms leads to {', '.join(unjoined)}")
    if checks.settled_share is not None and checks.settled_share < 1.0 and "rest" not in placed:
        found.append(f"only {checks.settled_share:.0%} of the free bodies stay within {MAX_DRIFT_M} m")
    if checks.stability is not None and not _is_stable(checks.stability):
        found.append(f"{checks.stability.furthest}, pushed a little, {_pushed_way(checks.stability)}")
    return [*found, *(fault.sentence for fault in faults)]


def _is_stable(stability: StabilityChecks) -> bool:
    return stability.max_moved_m <= MAX_MOVED_M and stability.max_sunk_m <= MAX_SUNK_M


def _pushed_way(stability: StabilityChecks) -> str:
    return f"moves {_mm(stability.max_moved_m)}, at most {_mm(stability.max_sunk_m)} down"


def rooms_apart(checks: WorldChecks) -> list[str]:
    """Lists the rooms that are not connected to the first one."""
    left = [room.name for room in checks.rooms]
    fresh = left[:1]
    while fresh:
        name = fresh.pop()
        if name in left:
            left.remove(name)
            fresh += [other for way in checks.room_graph if name in way.rooms for other in way.rooms]
    return left


def proof_lines(world: World) -> list[ProofLine]:
    """Lists the measurements of a world, as lines for people."""
    from .standing_doors import rooms_behind_doors  # it needs numpy, and `violations` does not

    checks = world.checks
    behind = rooms_behind_doors(world)
    measured = (
        []
        if checks is None
        else [
            *_plan_lines(checks, world, behind),
            *_room_lines(checks, behind),
            *_physics_lines(checks, world),
            _geoms_line(world, checks),
            *_file_lines(world, checks),
        ]
    )
    return [*measured, *_origin_lines(world)]


def _plan_lines(checks: WorldChecks, world: World, behind: Sequence[str]) -> Iterator[ProofLine]:
    apart = rooms_apart(checks)
    rooms, ways = counted(len(checks.rooms), "room"), counted(len(checks.room_graph), "way")
    joined = f"no way to {', '.join(apart)}" if apart else f"{rooms}, {ways}"
    if checks.rooms:
        yield ProofLine("Rooms joined", joined, _verdict(not apart))
    for way, passage in zip(checks.room_graph, world.floorplan.passages, strict=False):
        kind = way.kind if way.door is None else f"{way.kind} with {way.door}"
        wide = _verdict(way.clear_width_m >= MIN_PASSAGE_M)
        yield ProofLine(" - ".join(way.rooms), f"{kind}, {way.clear_width_m:.2f} m clear{_as_it_stands(passage)}", wide)
    share = f"{checks.reachable_share:.1%} of where a disc of {checks.robot_radius_m:g} m radius fits"
    share += "" if checks.reachable_m2 is None else f", {checks.reachable_m2:.1f} m²"
    reached = all(cells >= MIN_CELLS for cells in checks.reachable_cells.values()) and not checks.unreachable_goals
    yield ProofLine("Reachable from the origin", share, _verdict(reached))
    if behind:
        more = f"; a robot of {checks.robot_radius_m:g} m radius has to push a door to get there"
        yield ProofLine("Behind doors not open enough", ", ".join(behind) + more, "warning")
    clear = "clear" if checks.origin_clear else "not clear"
    yield ProofLine(f"Cylinder of {2 * ORIGIN_RADIUS_M:g} m at the origin", clear, _verdict(checks.origin_clear))


def _as_it_stands(passage: Passage) -> str:
    """Says what is clear of a passage whose door is not fully open at first, after what is clear when it is."""
    from .standing_doors import clear_as_it_stands_m, stands_open

    if passage.door is None or stands_open(passage):
        return ""
    if passage.door.open_percent <= 0:
        return " when open; it stands closed"
    return f" when open; {clear_as_it_stands_m(passage):.2f} m as it stands, {passage.door.open_percent:g} % open"


def _room_lines(checks: WorldChecks, behind: Sequence[str]) -> Iterator[ProofLine]:
    measures = {room.name: room for room in checks.rooms}
    for name, cells in checks.reachable_cells.items():
        kept = cells >= MIN_CELLS and name not in checks.unreachable_goals
        room = measures.get(name)
        opened = " when doors are open" if name in behind else ""
        value = f"{cells} cells reached{opened}" + ("" if room is None else _adherence(room))
        yield ProofLine(name, value, _verdict(kept))


def _adherence(room: RoomMeasures) -> str:
    aspect = f"aspect ratio {room.aspect_ratio:.2f} ({room.aspect_error:+.0%})"
    return f" ({room.reachable_share:.1%}), area {room.area_error:+.1%}, {aspect}"


def _physics_lines(checks: WorldChecks, world: World) -> Iterator[ProofLine]:
    deep = (
        f"{checks.penetrations} deeper than {1e3 * MAX_PENETRATION_M:g} mm, the deepest {_mm(checks.max_penetration_m)}"
    )
    apart = _verdict(checks.max_penetration_m <= MAX_PENETRATION_M)
    if checks.penetrating is None:
        deep += "; between parts that never move, an earlier generator did not look"
        apart = "not measured" if apart == "holds" else apart
    yield ProofLine("Penetrations at time 0", deep, apart)
    name = f"Free bodies that move less than {1e3 * MAX_DRIFT_M:g} mm"
    if checks.settled_share is None:
        yield ProofLine(name, "the settle was not run", "not measured")
    else:
        span = "" if checks.settle_s is None else f" of {checks.free_bodies} in {checks.settle_s:g} s"
        furthest = "" if checks.max_drift_m is None else f", the furthest {_mm(checks.max_drift_m)}"
        yield ProofLine(name, f"{checks.settled_share:.0%}{span}{furthest}", _verdict(checks.settled_share >= 1.0))
    if checks.stability is not None:
        pushed = checks.stability
        value = f"the furthest of {pushed.pushes} x {pushed.pushed_s:g} s {_pushed_way(pushed)}"
        yield ProofLine(f"Loose objects pushed by {pushed.push_mps:g} m/s", value, _verdict(_is_stable(pushed)))
    if checks.wishes is not None:
        count = checks.wishes
        whose = "drawing" if world.source else "template"
        granted = f"{count.satisfied} granted, {count.missed} missed, {count.contradictory} contradictory"
        yield ProofLine(f"Wishes of the {whose}", granted, "")


def _geoms_line(world: World, checks: WorldChecks) -> ProofLine:
    """Returns the line with the number of geoms that collide.

    They are counted now or, for stored worlds, by their generator.
    """
    major = world.generator_version.partition(".")[0]
    counted_all = checks.faults is None and major.isdecimal() and int(major) < _COUNTS_COLLIDING
    more = ", those for the eye among them, which an earlier generator counted as well" if counted_all else ""
    return ProofLine("Geoms that collide", f"{checks.geoms}{more}", "not measured" if counted_all else "")


_COUNTS_COLLIDING = 3
"""First generator version whose worlds store the number of colliding geoms, and not of all geoms."""

_COMPARED: dict[Guarantee, tuple[str, str]] = {
    "parts": ("Model and world.json", "the same floors, walls and pieces"),
    "doors": ("Doors and world.json", "hung and open as described"),
    "map": ("Map and model", "each cell as it is"),
    "lidar": ("Lidar and map", "rays end at what the map shows, and that collides"),
    "description": ("world_description.json", "as world.json"),
    "files": ("Files and manifest", "as they were stored"),
}
"""Guarantees that files agree with each other: their name, and the text if they do."""
_IMPORTED = "the same pieces; floors, walls and other parts are not compared"


def _file_lines(world: World, checks: WorldChecks) -> Iterator[ProofLine]:
    """Yields lines about the agreement of model and bundle files; only `robomaker world prove` compares them."""
    if checks.faults is None:
        return
    for guarantee, (name, agrees) in _COMPARED.items():
        faults = [fault for fault in checks.faults if fault.guarantee == guarantee]
        more = f"; and {len(faults) - 1} more" if len(faults) > 1 else ""
        if faults:
            yield ProofLine(name, faults[0].sentence + more, "broken")
        elif checks.not_compared and guarantee in checks.not_compared:
            yield ProofLine(name, checks.not_compared[guarantee], "not measured")
        else:
            of_pieces = guarantee == "parts" and isinstance(world.source, GazeboSource)
            yield ProofLine(name, _IMPORTED if of_pieces else agrees, "holds")


def _origin_lines(world: World) -> Iterator[ProofLine]:
    yield ProofLine("Seeds", f"floor plan {world.floorplan_seed}, interior {world.interior_seed}", "")
    yield ProofLine("Generator", f"{world.generator_version}, interior attempt {world.interior_attempt + 1}", "")


def _verdict(kept: bool) -> Verdict:
    return "holds" if kept else "broken"


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.2g} mm"
