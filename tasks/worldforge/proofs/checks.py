"""Measures a world for its guarantees; `guarantees` decides which limits it breaks."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ....schemas.worlds.world import (
    Floorplan,
    Passage,
    PreferenceCount,
    Room,
    RoomMeasures,
    RoomWay,
    World,
    WorldChecks,
    bounds,
)
from ..doors.door_parts import FULLY_OPEN_PERCENT, leaf_outlines
from ..geometry.occupancy import OccupancyGrid, connected, fitting, occupancy_grid, reachable, room_cells
from .guarantees import MAX_DRIFT_M, MAX_PENETRATION_M, MIN_CELLS, MOST_TOLD, ORIGIN_RADIUS_M, SETTLE_S
from .overlaps import drift_m, find_overlaps, measure_stability

_WALL_FLOOR_M = 0.4
"""A wall that begins above this leaves a way below it."""

_JUNCTION_M = 0.051
"""Half an inner wall, where a wall across ends when the wall it meets has been taken away for an opening."""

_ORIGIN = (0.0, 0.0)


def check_world(
    world: World,
    mjcf: str | Path,
    grid: OccupancyGrid,
    *,
    robot_radius_m: float = 0.2,
    settle_s: float | None = None,
    pushed: bool = False,
) -> WorldChecks:
    """Measures everything that a world's guarantees need: overlaps, reachability, stability.

    Args:
        world: the world.
        mjcf: its model, from `proof_mjcf`, or the file in its bundle.
        grid: its map, from `occupancy_grid`, with all doors fully open, since a robot can push them.
        robot_radius_m: radius of the disc that has to reach every room from the origin.
        settle_s: how long to let physics run, with every body awake at first; None leaves that out.
        pushed: whether loose objects are pushed, too, which takes twenty times longer.

    Raises:
        ValueError: when MuJoCo does not accept the model.
    """
    plan = world.floorplan
    load = mujoco.MjModel.from_xml_path if isinstance(mjcf, Path) else mujoco.MjModel.from_xml_string
    model = load(str(mjcf))
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # earlier generators let loose objects sleep
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    overlaps = find_overlaps(model, data)
    deep = [overlap for overlap in overlaps if overlap.depth_m > MAX_PENETRATION_M]
    ways = [_way(passage, plan) for passage in plan.passages]
    drift = drift_m(model, settle_s) if settle_s is not None else None
    return WorldChecks(
        robot_radius_m=robot_radius_m,
        **_reach(plan.rooms, grid, robot_radius_m),
        closed_off_rooms=_closed_off(world, robot_radius_m),
        origin_clear=_origin_clear(grid),
        max_penetration_m=round(overlaps[0].depth_m, 6) if overlaps else 0.0,
        penetrations=len(deep),
        penetrating=[overlap.parts for overlap in deep[:MOST_TOLD]],
        geoms=int(model.ngeom),
        narrowest_passage_m=min((way.clear_width_m for way in ways), default=None),
        room_graph=ways,
        footprint_aspect_ratio=_aspect(plan),
        wishes=_preferences(world),
        free_bodies=int(model.njnt),
        settle_s=settle_s,
        settled_share=None if drift is None else round(float(np.mean(drift < MAX_DRIFT_M)) if len(drift) else 1.0, 4),
        max_drift_m=None if drift is None else round(float(drift.max(initial=0.0)), 6),
        stability=measure_stability(model, world.interior_seed) if pushed else None,
    )


def prove(world: World, model_file: Path, *, pushed: bool) -> WorldChecks:
    """Measures a stored world again, whichever generator version made it.

    Args:
        world: the world.
        model_file: its MJCF, in the bundle.
        pushed: whether loose objects are pushed, too.

    Raises:
        ValueError: when MuJoCo does not accept the model.
    """
    # A robot can push doors open: what it reaches then is what counts.
    grid = occupancy_grid(world.floorplan, world.furniture, leaf_outlines(world.floorplan, fully_open=True))
    return check_world(world, model_file, grid, settle_s=SETTLE_S, pushed=pushed)


def _reach(rooms: Sequence[Room], grid: OccupancyGrid, radius_m: float) -> dict[str, Any]:
    """Cells and goals that a robot reaches, in all and room by room."""
    fits = fitting(grid, radius_m)
    reached = connected(fits, grid.cell(_ORIGIN))
    measures: list[RoomMeasures] = []
    cells: dict[str, int] = {}
    for room in rooms:
        inside = room_cells(grid, room)
        cells[room.name] = int(np.count_nonzero(reached & inside))
        measures.append(_measures(room, int(np.count_nonzero(fits & inside)), cells[room.name]))
    return {
        "reachable_share": _share(int(np.count_nonzero(reached)), int(np.count_nonzero(fits))),
        "reachable_cells": cells,
        "unreachable_goals": [room.name for room in rooms if not reached[grid.cell(room.goal)]],
        "rooms": measures,
    }


def _closed_off(world: World, radius_m: float) -> list[str]:
    """Rooms that a robot reaches only when it pushes a door."""
    plan = world.floorplan
    if all(passage.door is None or passage.door.open_percent == FULLY_OPEN_PERCENT for passage in plan.passages):
        return []
    grid = occupancy_grid(plan, world.furniture, leaf_outlines(plan))
    reached = reachable(grid, _ORIGIN, radius_m)
    return [room.name for room in plan.rooms if np.count_nonzero(reached & room_cells(grid, room)) < MIN_CELLS]


def _measures(room: Room, fitting_cells: int, reached: int) -> RoomMeasures:
    ratio = room.aspect_ratio or 1.0
    return RoomMeasures(
        name=room.name,
        area_error=round(room.floor_m2 / room.desired_area_m2 - 1, 4) + 0.0,
        aspect_ratio=ratio,
        aspect_error=round(ratio / room.desired_aspect_ratio - 1, 4) + 0.0,
        fitting_cells=fitting_cells,
        reachable_share=_share(reached, fitting_cells),
    )


def _share(part: int, whole: int) -> float:
    return round(part / whole, 4) if whole else 0.0


def _way(passage: Passage, plan: Floorplan) -> RoomWay:
    width = _gap(passage, plan)
    door = passage.door
    if door is not None:
        width -= max(0.0, passage.width_m - door.clear_width_m)
    return RoomWay(
        rooms=passage.rooms, kind=passage.kind, clear_width_m=round(width, 4), door=None if door is None else door.id
    )


def _gap(passage: Passage, plan: Floorplan) -> float:
    """Distance along a passage's line between what stands at its two sides: a wall's end, or a wall across."""
    along = 0 if passage.start[1] == passage.end[1] else 1
    line = passage.start[1 - along]
    middle = (passage.start[along] + passage.end[along]) / 2
    low, high = -np.inf, np.inf
    for wall in plan.walls:
        if wall.bottom_m >= _WALL_FLOOR_M:
            continue
        half = wall.thickness_m / 2
        first, last = sorted((wall.start[along], wall.end[along]))
        side, other = sorted((wall.start[1 - along], wall.end[1 - along]))
        if first == last:  # it crosses the line, or ends at it
            first, last = first - half, last + half
        else:
            side, other = side - half, other + half
        if not side - _JUNCTION_M <= line <= other + _JUNCTION_M:
            continue
        if last <= middle:
            low = max(low, last)
        elif first >= middle:
            high = min(high, first)
        else:
            return 0.0
    return float(high - low)


def _aspect(plan: Floorplan) -> float:
    x0, y0, x1, y1 = bounds(plan.footprint)
    return round((x1 - x0) / (y1 - y0), 4)


def _preferences(world: World) -> PreferenceCount:
    count = Counter(preference.outcome for preference in (*world.floorplan.wishes, *world.wishes))
    return PreferenceCount(satisfied=count["satisfied"], missed=count["missed"], contradictory=count["contradictory"])


def _origin_clear(grid: OccupancyGrid) -> bool:
    """Whether no occupied cell reaches into the disc at the origin."""
    row, column = grid.cell(_ORIGIN)
    reach = round(ORIGIN_RADIUS_M / grid.resolution_m) + 2
    south, west = max(0, row - reach), max(0, column - reach)
    rows, columns = np.nonzero(~grid.free[south : row + reach, west : column + reach])
    x = np.abs(grid.origin[0] + (columns + west + 0.5) * grid.resolution_m) - grid.resolution_m / 2
    y = np.abs(grid.origin[1] + (rows + south + 0.5) * grid.resolution_m) - grid.resolution_m / 2
    return bool(np.all(np.hypot(np.maximum(x, 0), np.maximum(y, 0)) >= ORIGIN_RADIUS_M - 1e-6))
