"""Measures the compiled model of a world for its guarantees; `guarantees` decides which limits it breaks."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import (
    Fault,
    Floorplan,
    GazeboSource,
    Guarantee,
    Point,
    PreferenceCount,
    Room,
    RoomMeasures,
    World,
    WorldChecks,
    bounds,
)
from ..geometry.occupancy import OccupancyGrid, connected, fitting, reachable, room_cells
from .guarantees import MAX_DRIFT_M, MAX_PENETRATION_M, MIN_CELLS, MOST_TOLD, ORIGIN_RADIUS_M
from .overlaps import THROWN_M, Overlap, drift_m, find_overlaps, measure_stability, meet
from .parts import room_at
from .reach import ground_of, measure_ways, share, with_leaves
from .scan import Scan

_ORIGIN = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Site:
    """The compiled model of a world, and the maps of it that are measured."""

    scan: Scan
    first: OccupancyGrid
    """Occupancy map with everything in its initial state."""
    opened: OccupancyGrid
    """Map with the doors fully open, since a robot can push them; the same object if they are so initially."""
    origin_clear: bool
    """Whether the robot's start position is free of obstacles."""
    is_planned: bool
    """Whether the world has a floor plan of rooms and doors; imported worlds have none."""


def planned_site(world: World, model: mujoco.MjModel) -> Site:
    """Prepares the model of a generated world for its checks.

    Args:
        world: The world.
        model: Model of the world, from `proof_mjcf` or its bundle; its loose objects are awake afterwards.
    """
    scan = awake_scan(world, model)
    ground = ground_of(world, scan)
    first = with_leaves(ground, scan.leaves)
    opened = first if scan.open_leaves is scan.leaves else with_leaves(ground, scan.open_leaves)
    return Site(scan, first, opened, _origin_clear(opened), is_planned=True)


def awake_scan(world: World, model: mujoco.MjModel) -> Scan:
    """Returns the solid parts of a model, with all its loose objects awake.

    Args:
        world: The world.
        model: Model of the world, which is changed.
    """
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # earlier generators let loose objects sleep
    return Scan(model, {passage.door.id for passage in world.floorplan.passages if passage.door})


def check_world(
    world: World,
    site: Site,
    *,
    robot_radius_m: float = 0.2,
    settle_s: float | None = None,
    pushed: bool = False,
    placed: bool = False,
) -> WorldChecks:
    """Measures on a world's model all that its guarantees need: overlaps, reach, ways, stability.

    Args:
        world: The world; it says where rooms, passages and goals are.
        site: Model of the world.
        robot_radius_m: Radius of the disc that has to reach every room from the origin.
        settle_s: How long to let physics run, with every body awake at first; None leaves that out.
        pushed: Whether loose objects are pushed, too, which takes twenty times longer.
        placed: Whether the places are listed where a guarantee is broken.
    """
    plan, scan = world.floorplan, site.scan
    reach = _Reach.of(site.opened, robot_radius_m)
    cells = {room.name: room_cells(site.opened, room) for room in plan.rooms}
    ways, narrow = measure_ways(world, scan)
    overlaps = find_overlaps(scan.model, scan.data)
    if not site.is_planned:  # its fixed parts overlap as its author built them
        overlaps = [each for each in overlaps if _matters(scan.model, each) and each.depth_m > MAX_PENETRATION_M]
    deep = [overlap for overlap in overlaps if overlap.depth_m > MAX_PENETRATION_M]
    drift = drift_m(scan.model, settle_s) if settle_s is not None else None
    faults = [*_unreached(world, reach), *narrow, *_overlapping(world, scan, deep), *_restless(world, scan, drift)]
    return WorldChecks(
        robot_radius_m=robot_radius_m,
        reachable_share=share(reach.reached, reach.fits),
        reachable_cells={name: int(np.count_nonzero(reach.reached & inside)) for name, inside in cells.items()},
        unreachable_goals=[name for name, goal in goals_of(world) if not reach.has(goal)],
        rooms=[_measures(room, reach, cells[room.name]) for room in plan.rooms] if site.is_planned else [],
        closed_off_rooms=_closed_off(site, cells, robot_radius_m),
        origin_clear=site.origin_clear,
        max_penetration_m=round(overlaps[0].depth_m, 6) if overlaps else 0.0,
        penetrations=len(deep),
        penetrating=[
            (scan.called(one), scan.called(other)) for one, other in (each.geoms for each in deep[:MOST_TOLD])
        ],
        geoms=int(np.count_nonzero(scan.model.geom_contype | scan.model.geom_conaffinity)),
        narrowest_passage_m=min((way.clear_width_m for way in ways), default=None),
        room_graph=ways,
        footprint_aspect_ratio=_aspect(plan) if site.is_planned else None,
        wishes=_preferences(world) if site.is_planned else None,
        free_bodies=int(scan.model.njnt),
        settle_s=settle_s,
        settled_share=None if drift is None else round(float(np.mean(drift < MAX_DRIFT_M)) if len(drift) else 1.0, 4),
        max_drift_m=None if drift is None else round(float(drift.max(initial=0.0)), 6),
        stability=measure_stability(scan.model, world.interior_seed) if pushed else None,
        reachable_m2=None if site.is_planned else reach.area_m2,
        faults=faults if placed else None,
    )


def _fault(world: World, guarantee: Guarantee, said: str, place: Sequence[float]) -> Fault:
    return Fault.placed(guarantee, said, place, room_at(world, place))


def _unreached(world: World, reach: "_Reach") -> Iterator[Fault]:
    for name, goal in goals_of(world):
        if not reach.has(goal):
            yield _fault(world, "reach", f"{name}: its goal is out of a robot's reach", goal)


def _overlapping(world: World, scan: Scan, deep: Sequence[Overlap]) -> Iterator[Fault]:
    for overlap in deep[:MOST_TOLD]:
        one, other = overlap.geoms
        # The middle of what their boxes share.
        low, high = np.maximum(scan.low[one], scan.low[other]), np.minimum(scan.high[one], scan.high[other])
        both = f"{scan.called(one)} and {scan.called(other)}"
        said = f"{both} overlap by {overlap.depth_m:.3f} m, more than {MAX_PENETRATION_M} m"
        yield _fault(world, "overlaps", said, (low + high) / 2)


def _restless(world: World, scan: Scan, drift: NDArray[np.float64] | None) -> Iterator[Fault]:
    """Yields the bodies that move by themselves, those that move furthest first.

    Nothing is yielded if `drift`, the metres that each joint's body moved, was not measured.
    """
    if drift is None:
        return
    for joint in np.argsort(-drift)[:MOST_TOLD].tolist():
        if not drift[joint] < MAX_DRIFT_M:
            body = int(scan.model.jnt_bodyid[joint])
            way = "flies away" if drift[joint] >= THROWN_M else f"moves {drift[joint]:.2f} m by itself"
            name = scan.model.body(body).name or "a body without a name"
            yield _fault(world, "rest", f"{name} {way}", scan.data.xpos[body])


class _Reach(NamedTuple):
    """Cells that a disc-shaped robot reaches from the origin."""

    grid: OccupancyGrid
    fits: NDArray[np.bool_]
    reached: NDArray[np.bool_]

    @classmethod
    def of(cls, grid: OccupancyGrid, radius_m: float) -> "_Reach":
        fits = fitting(grid, radius_m)
        return cls(grid, fits, connected(fits, grid.cell(_ORIGIN)))

    @property
    def area_m2(self) -> float:
        return round(int(np.count_nonzero(self.reached)) * self.grid.resolution_m**2, 3)

    def has(self, goal: Point) -> bool:
        row, column = self.grid.cell(goal)
        rows, columns = self.reached.shape
        return 0 <= row < rows and 0 <= column < columns and bool(self.reached[row, column])


def goals_of(world: World) -> list[tuple[str, Point]]:
    """Returns name and position of the goals of rooms, and of those that the notes of an imported world name."""
    named = world.source.goals if isinstance(world.source, GazeboSource) else {}
    return [*((room.name, room.goal) for room in world.floorplan.rooms), *named.items()]


def _matters(model: mujoco.MjModel, overlap: Overlap) -> bool:
    """Whether an overlap of two parts counts: one of them can move, and they collide."""
    bodies = model.geom_bodyid[[*overlap.geoms]]
    return meet(model, *overlap.geoms) and bool(np.isin(bodies, model.jnt_bodyid).any())


def _closed_off(site: Site, cells: Mapping[str, NDArray[np.bool_]], radius_m: float) -> list[str]:
    """Returns the rooms that a robot reaches only if it pushes a door open."""
    if site.opened is site.first:
        return []
    reached = reachable(site.first, _ORIGIN, radius_m)
    return [name for name, inside in cells.items() if np.count_nonzero(reached & inside) < MIN_CELLS]


def _measures(room: Room, reach: _Reach, inside: NDArray[np.bool_]) -> RoomMeasures:
    ratio = room.aspect_ratio or 1.0
    return RoomMeasures(
        name=room.name,
        area_error=round(room.floor_m2 / room.desired_area_m2 - 1, 4) + 0.0,
        aspect_ratio=ratio,
        aspect_error=round(ratio / room.desired_aspect_ratio - 1, 4) + 0.0,
        fitting_cells=int(np.count_nonzero(reach.fits & inside)),
        reachable_share=share(reach.reached & inside, reach.fits & inside),
    )


def _aspect(plan: Floorplan) -> float:
    """Returns the aspect ratio of the building, balconies left out."""
    x0, y0, x1, y1 = bounds(corner for room in plan.rooms if not room.is_outdoor for corner in room.polygon)
    return round((x1 - x0) / (y1 - y0), 4)


def _preferences(world: World) -> PreferenceCount:
    count = Counter(preference.outcome for preference in (*world.floorplan.wishes, *world.wishes))
    return PreferenceCount(satisfied=count["satisfied"], missed=count["missed"], contradictory=count["contradictory"])


def _origin_clear(grid: OccupancyGrid) -> bool:
    """Whether no occupied map cell is in the disc around the origin."""
    row, column = grid.cell(_ORIGIN)
    reach = round(ORIGIN_RADIUS_M / grid.resolution_m) + 2
    south, west = max(0, row - reach), max(0, column - reach)
    rows, columns = np.nonzero(~grid.free[south : row + reach, west : column + reach])
    x = np.abs(grid.origin[0] + (columns + west + 0.5) * grid.resolution_m) - grid.resolution_m / 2
    y = np.abs(grid.origin[1] + (rows + south + 0.5) * grid.resolution_m) - grid.resolution_m / 2
    return bool(np.all(np.hypot(np.maximum(x, 0), np.maximum(y, 0)) >= ORIGIN_RADIUS_M - 1e-6))
