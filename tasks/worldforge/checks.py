"""Measures what a world guarantees, and says which guarantee it breaks."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np

from ...schemas.world import World, WorldChecks
from .occupancy import OccupancyGrid, cells_by_room, clearance, reachable

MAX_PENETRATION_M = 0.005
MIN_CELLS = 5
MAX_DRIFT_M = 0.01
ORIGIN_RADIUS_M = 0.5
SETTLE_S = 2.0

_ORIGIN = (0.0, 0.0)


def check_world(
    world: World,
    mjcf: str,
    grid: OccupancyGrid,
    *,
    robot_radius_m: float = 0.2,
    settle_s: float | None = None,
) -> WorldChecks:
    """Measures a world.

    Args:
      world: the world.
      mjcf: its model, from `world_mjcf`.
      grid: its map, from `occupancy_grid`.
      robot_radius_m: radius of the disc that has to reach every room from the origin.
      settle_s: how long to let physics run with every body awake; None leaves that out.

    Raises:
      ValueError: when MuJoCo does not accept the model.
    """
    model = mujoco.MjModel.from_xml_string(mjcf)
    # Asleep, bodies have no contacts and never move: a floating or half-sunk book would pass.
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    reached = reachable(grid, _ORIGIN, robot_radius_m)
    room_for_disc = int(np.count_nonzero(clearance(grid) >= robot_radius_m))
    plan = world.floorplan
    return WorldChecks(
        robot_radius_m=robot_radius_m,
        reachable_share=round(min(1.0, np.count_nonzero(reached) / max(1, room_for_disc)), 4),
        reachable_cells=dict(cells_by_room(grid, reached, plan.rooms)),
        origin_clear=_origin_clear(grid),
        max_penetration_m=round(max((-float(gap) for gap in data.contact.dist), default=0.0), 6) + 0.0,
        geoms=int(model.ngeom),
        unreachable_goals=[room.name for room in plan.rooms if not reached[grid.cell(room.goal)]],
        narrowest_passage_m=min((passage.width_m for passage in plan.passages), default=None),
        settled_share=None if settle_s is None else _settled_share(model, settle_s),
    )


def violations(checks: WorldChecks) -> list[str]:
    """The broken guarantees, one sentence each; empty for a valid world."""
    found: list[str] = []
    for name, cells in checks.reachable_cells.items():
        if cells < MIN_CELLS:
            found.append(f"{name}: a robot of {checks.robot_radius_m} m radius reaches {cells} cells, not {MIN_CELLS}")
    found += [f"{name}: its goal is out of a robot's reach" for name in checks.unreachable_goals]
    if not checks.origin_clear:
        found.append(f"the cylinder of {2 * ORIGIN_RADIUS_M:g} m diameter at the origin is not clear")
    if checks.max_penetration_m > MAX_PENETRATION_M:
        found.append(f"bodies overlap by {checks.max_penetration_m} m at the start, more than {MAX_PENETRATION_M} m")
    if checks.narrowest_passage_m is not None and checks.narrowest_passage_m < 2 * checks.robot_radius_m:
        found.append(f"a passage is {checks.narrowest_passage_m} m wide, less than the robot")
    if checks.settled_share is not None and checks.settled_share < 1.0:
        found.append(f"only {checks.settled_share:.0%} of the loose objects stay within {MAX_DRIFT_M} m")
    return found


def _origin_clear(grid: OccupancyGrid) -> bool:
    """Whether no occupied cell reaches into the disc at the origin."""
    rows, columns = np.nonzero(~grid.free)
    x = np.abs(grid.origin[0] + (columns + 0.5) * grid.resolution_m) - grid.resolution_m / 2
    y = np.abs(grid.origin[1] + (rows + 0.5) * grid.resolution_m) - grid.resolution_m / 2
    return bool(np.all(np.hypot(np.maximum(x, 0), np.maximum(y, 0)) >= ORIGIN_RADIUS_M - 1e-6))


def _settled_share(model: mujoco.MjModel, settle_s: float) -> float:
    """Share of the loose objects that stay where they are."""
    bodies = [int(model.jnt_bodyid[joint]) for joint in range(model.njnt)]
    if not bodies:
        return 1.0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.xpos[bodies].copy()
    mujoco.mj_step(model, data, nstep=round(settle_s / model.opt.timestep))
    drift = np.linalg.norm(data.xpos[bodies] - before, axis=1)
    return float(np.mean(drift < MAX_DRIFT_M))
