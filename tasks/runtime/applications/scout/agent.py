"""Agent of the robot application `scout`: visits every room of a world on a short tour, and avoids obstacles."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import dm_env
import numpy as np
from numpy.typing import NDArray

from .....schemas.runs.plan import why_a_world
from .....schemas.wire.errors import LaunchError
from .....schemas.worlds.world import Point
from ...episode.context import KeepsAttributes, SimulationContext
from ...episode.occupancy_map import OccupancyMap, read_world_map
from ...recording import messages as ros
from ...recording.messages import Path, PoseStamped
from ...recording.recording import Recorder
from ...robots.robot import Lidar, Limits, robot_of
from ...robots.scout import LIDAR, LIMITS
from .following import PathFollower
from .obstacles import ObstacleMemory, Pose, free_ahead, near_hits, nearest_to_path, ray_directions
from .planner import GridPlanner, WayKind
from .planner import Path as Points

EXACT_PLACES = 9
"""Number of places up to which the shortest tour is computed exactly (about 20,000 sums); most worlds have at most six
rooms.
"""

Table = Sequence[Sequence[float]]


def plan_tour(distances: NDArray[np.float64]) -> list[int]:
    """Orders places into a short open tour that begins at place 0.

    Few places are visited on the shortest tour (M. Held, R. M. Karp, "A dynamic programming approach to sequencing
    problems", 1962), many on a nearest-neighbour tour that 2-opt improves.

    Args:
        distances: Path lengths between places, shape (n, n), symmetric; infinite where there is no path.

    Returns:
        The places that can be reached from place 0, without it.
    """
    table = distances.tolist()
    places = [place for place in range(1, len(table)) if np.isfinite(table[0][place])]
    return _shortest(places, table) if len(places) <= EXACT_PLACES else _untangled(places, table)


def _shortest(places: list[int], table: Table) -> list[int]:
    """Returns the places in the order of the shortest open tour from place 0, by dynamic programming over all sets.

    Time and memory double with each place; longer tours use `_untangled`.

    Args:
        places: Places to visit, as indices of the table.
        table: Path costs between places.
    """
    if not places:
        return []
    # Length of the best tour through a set of places to the last of them, and that tour.
    best = {(1 << number, number): (table[0][place], [place]) for number, place in enumerate(places)}
    for _ in places[1:]:
        longer: dict[tuple[int, int], tuple[float, list[int]]] = {}
        for (visited, last), (length, tour) in best.items():
            for number, place in enumerate(places):
                if visited >> number & 1:
                    continue
                key, way = (visited | 1 << number, number), (length + table[places[last]][place], [*tour, place])
                if key not in longer or way < longer[key]:
                    longer[key] = way
        best = longer
    return min(best.values())[1]


def _untangled(places: list[int], table: Table) -> list[int]:
    """Returns the places in the order of a good open tour from place 0, which need not be the shortest.

    It is a nearest-neighbour tour, of which stretches are reversed (2-opt) as long as that shortens it.

    Args:
        places: Places to visit, as indices of the table.
        table: Path costs between places.
    """
    left, tour = set(places), [0]
    while left:
        here = table[tour[-1]]
        nearest = min(left, key=lambda place: (here[place], place))
        left.remove(nearest)
        tour.append(nearest)
    improved = True
    while improved:
        improved = False
        for first in range(1, len(tour) - 1):
            for last in range(first + 1, len(tour)):
                before = table[tour[first - 1]][tour[first]]
                after = table[tour[first - 1]][tour[last]]
                if last + 1 < len(tour):
                    before += table[tour[last]][tour[last + 1]]
                    after += table[tour[first]][tour[last + 1]]
                if after < before - 1e-9:
                    tour[first : last + 1] = tour[first : last + 1][::-1]
                    improved = True
    return tour[1:]


_EVERY_POINTS = 4
"""Points of a path per published point, which are then 20 cm apart."""

_FRAME = "map"


def publish_plan(recorder: Recorder, goal: Point, path: Points, time_s: float) -> None:
    """Records the ROS topics `/goal_pose` and `/plan`, as navigation stacks publish them.

    Does nothing if the run is not recorded.

    Args:
        recorder: Recorder of the run.
        goal: Goal of the path, metres.
        path: Points of the path, shape (n, 2), metres.
        time_s: Simulated time.
    """
    if not recorder.enabled:
        return
    header = ros.Header(ros.Time.from_seconds(time_s), _FRAME)
    points = [*path[:-1:_EVERY_POINTS].tolist(), path[-1].tolist()]
    poses = [PoseStamped(header, ros.Pose(ros.Vector3(x, y))) for x, y in points]
    recorder.write("/goal_pose", PoseStamped(header, ros.Pose(ros.Vector3(*goal))), time_s)
    recorder.write("/plan", Path(header, poses), time_s)


_logger = logging.getLogger(__name__)

_STOP = (0.0, 0.0)

_GOODBYE_S = 1.0
"""Seconds between the final stop and the agent's end of the run, in which the environment may end the run itself."""

_SPEED_LIMIT_MPS: dict[WayKind, float] = {"free": math.inf, "tight": 0.2, "pushing": 0.09}

_CAREFUL_MPS = 0.25
_CAREFUL_WITHIN_M = 0.3
_CREEPING_MPS = 0.08
_CLOSING_S = 0.45
"""Minimum time to collision in seconds with anything straight ahead, by which the speed is limited."""

_LOOK_AHEAD_M = 1.0
_REPLAN_PERIOD_S = 0.6

_TRIES = 3
"""Number of tries for a room when the robot gets stuck or finds no path, before the room is postponed or given up."""

_STUCK_S = 1.5
_PROGRESS_M = 0.04
_PROGRESS_RAD = 0.15

_BACK_S = 1.0
_BACK_MPS = -0.2
_BUMP_MARGIN_M = 0.03
_BUMP_ARC_RAD = np.linspace(-0.6, 0.6, 7)


class _Anchor(NamedTuple):
    """Pose and time at which the robot last made progress, to detect that it is stuck."""

    time_s: float
    pose: Pose


class Scout(KeepsAttributes):
    """Built-in robot program: explores every room; called with every time step, it returns a velocity command."""

    KEPT = (
        *("_queue", "_put_off", "_follower", "_way_kind", "_tries", "_backing_until_s", "_planned_s", "_scan_s"),
        *("_speed_limit", "_anchor", "_done_s", "given_up"),
    )

    def __init__(
        self,
        known: OccupancyMap,
        goals: Mapping[str, Point],
        limits: Limits = LIMITS,
        recorder: Recorder | None = None,
        lidar: Lidar = LIDAR,
    ) -> None:
        """Creates the built-in robot program for one run, before its first time step.

        Args:
            known: Occupancy map of the world.
            goals: A goal for each room by the room's name, metres.
            limits: Size, speed and acceleration limits of the robot.
            recorder: Recorder that gets every planned path.
            lidar: Specification of the robot's lidar.
        """
        self._recorder = recorder or Recorder()
        self._limits = limits
        self._rays = ray_directions(lidar.angles_rad)
        self._planner = GridPlanner(known, limits.radius_m)
        self._memory = ObstacleMemory(self._planner)
        self._goals = dict(goals)
        # Paths that depend on the map alone are computed before the run begins.
        self._planner.prepare(self._goals.values())
        self._queue: list[str] | None = None
        self._put_off: set[str] = set()
        self._follower: PathFollower | None = None
        self._way_kind: WayKind = "free"
        self._tries = 0
        self._backing_until_s = -math.inf
        self._planned_s = -math.inf
        self._scan_s = -math.inf
        self._speed_limit = limits.linear_mps
        self._anchor = _Anchor(0.0, (0.0, 0.0, 0.0))
        self._done_s = math.inf
        self.given_up: list[str] = []
        """Names of the rooms that could not be reached."""

    def state(self) -> dict[str, Any]:
        """Returns the agent's state for a checkpoint; planned paths are computed again."""
        return {**super().state(), "memory": self._memory.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores the agent's state from a checkpoint."""
        super().restore(state)
        self._memory.restore(state["memory"])

    @property
    def done(self) -> bool:
        """Whether every room was reached or given up; the robot stands still then."""
        return self._queue == []

    def __call__(self, timestep: dm_env.TimeStep) -> NDArray[np.float64]:
        """Computes the velocity command for a time step: forward velocity (m/s) and turning rate (rad/s).

        Raises:
            StopIteration: The robot has been standing still for a second with nothing left to do.
        """
        observation = timestep.observation
        x, y, yaw = observation["pose"].tolist()
        now_s = float(observation["time"])
        speed = float(observation["velocity"][0])
        if self._queue is None:
            self._queue = self._order_rooms((x, y))
            self._anchor = _Anchor(now_s, (x, y, yaw))
        if float(observation["scan_time"]) > self._scan_s:
            self._scan_s = float(observation["scan_time"])
            self._look((x, y, yaw), observation, now_s)
        return np.array(self._decide((x, y, yaw), speed, now_s))

    def run_notes(self) -> list[str]:
        """Returns a note about the rooms that the robot gave up."""
        rooms = ", ".join(self.given_up)
        return [f"scout gave up on {rooms}: no way there that the robot could drive"] if rooms else []

    def _decide(self, pose: Pose, speed: float, now_s: float) -> tuple[float, float]:
        if now_s < self._backing_until_s:
            self._anchor = _Anchor(now_s, pose)
            return _BACK_MPS, 0.0
        if self._follower is not None and self._follower.arrived:
            self._next_goal()
        if self._follower is None and not self._set_out(pose, now_s):
            self._done_s = min(self._done_s, now_s)
            if now_s - self._done_s > _GOODBYE_S:
                raise StopIteration
            return _STOP
        if self._is_stuck(pose, now_s):
            self._bump(pose, now_s)
            return _STOP
        follower = self._follower
        assert follower is not None
        return follower.command(*pose, speed, min(self._speed_limit, _SPEED_LIMIT_MPS[self._way_kind]))

    def _order_rooms(self, here: tuple[float, float]) -> list[str]:
        """Returns the rooms in the order of a short tour from a place in metres.

        Rooms without a path on the map come last.
        """
        rooms = list(self._goals)
        tour = plan_tour(self._planner.distances([here, *self._goals.values()]))
        order = [rooms[place - 1] for place in tour]
        return order + [room for room in rooms if room not in order]

    def _set_out(self, pose: Pose, now_s: float) -> bool:
        """Plans a path to the next reachable goal of the tour, and follows it from now on.

        Goals without a path are postponed or given up. Returns whether a path was found; if not, no goal is left.
        """
        while self._queue:
            self._planner.set_obstacles(self._memory.points(now_s))
            goal = self._goals[self._queue[0]]
            way = self._planner.plan(pose[:2], goal)
            self._planned_s = now_s
            if way is not None:
                self._follower, self._way_kind = PathFollower(way.path, self._limits), way.kind
                self._anchor = _Anchor(now_s, pose)
                publish_plan(self._recorder, goal, way.path, now_s)
                return True
            self._leave_goal()
        return False

    def _look(self, pose: Pose, observation: dict[str, NDArray[np.float32]], now_s: float) -> None:
        """Slows the robot down for unknown obstacles near its path, and drops the path when one blocks it."""
        hits = near_hits(self._rays, observation["scan"], observation["proximity"])
        unknown = self._memory.see(pose, hits, now_s)
        self._speed_limit = max(_CREEPING_MPS, free_ahead(hits, self._limits.radius_m) / _CLOSING_S)
        if self._follower is None or len(unknown) == 0:
            return
        gap_m = nearest_to_path(unknown, self._follower.ahead(_LOOK_AHEAD_M))
        if gap_m < _CAREFUL_WITHIN_M:
            self._speed_limit = min(self._speed_limit, _CAREFUL_MPS)
        blocked = gap_m < self._limits.radius_m and self._way_kind != "pushing"
        if blocked and now_s - self._planned_s >= _REPLAN_PERIOD_S:
            self._follower = None

    def _is_stuck(self, pose: Pose, now_s: float) -> bool:
        """Whether the robot has neither moved nor turned noticeably for a while, although it is commanded to.

        Remembers the pose from which it has moved on.
        """
        was = self._anchor.pose
        moved = math.hypot(pose[0] - was[0], pose[1] - was[1]) > _PROGRESS_M
        turned = abs(math.remainder(pose[2] - was[2], math.tau)) > _PROGRESS_RAD
        if moved or turned:
            self._anchor = _Anchor(now_s, pose)
        return now_s - self._anchor.time_s > _STUCK_S

    def _bump(self, pose: Pose, now_s: float) -> None:
        """Adds an obstacle in front of the robot to its memory, makes it back off, and drops its path, to plan again.

        After several tries the goal is postponed or given up.
        """
        x, y, yaw = pose
        arc, reach_m = yaw + _BUMP_ARC_RAD, self._limits.radius_m + _BUMP_MARGIN_M
        self._memory.add(np.stack((x + reach_m * np.cos(arc), y + reach_m * np.sin(arc)), axis=1), now_s)
        self._backing_until_s = now_s + _BACK_S
        self._follower = None
        self._tries += 1
        if self._tries >= _TRIES:
            self._leave_goal()

    def _next_goal(self) -> None:
        assert self._queue
        del self._queue[0]
        self._follower = None
        self._tries = 0

    def _leave_goal(self) -> None:
        """Postpones the current goal to the end of the tour; the second time, gives it up for good and logs that."""
        assert self._queue
        goal = self._queue[0]
        self._next_goal()
        if goal in self._put_off:
            self.given_up.append(goal)
            _logger.warning("gave up on %s: no way there that the robot could drive", goal)
        else:
            self._put_off.add(goal)
            self._queue.append(goal)


def make_agent(context: SimulationContext, environment: dm_env.Environment) -> Scout:
    """Makes the built-in robot program for one run.

    Args:
        context: Context of the run; the robot knows its world's map.
        environment: The environment `indoor-navigation`, or another one with the same observations and actions.

    Raises:
        LaunchError: There is no world or its map cannot be read, or the environment is of another kind.
    """
    if context.world is None or context.world_dir is None:
        raise LaunchError(why_a_world("scout") or "")
    given: Any = environment.observation_spec()
    missing = {"time", "pose", "velocity", "scan", "proximity", "scan_time"} - set(given)
    if missing:
        raise LaunchError(
            f"scout needs observations that the environment does not give: {', '.join(sorted(missing))}; "
            "use it with indoor-navigation"
        )
    try:
        known = read_world_map(context.world_dir)
    except (OSError, ValueError) as cause:
        raise LaunchError(f"scout cannot read the world's map: {cause}") from cause
    robot = robot_of(environment)
    goals = {room.name: room.goal for room in context.world.floorplan.rooms}
    lidar = robot.lidar if robot else None
    if lidar is None:  # as of an environment that does not say; its rays are all around
        lidar = replace(LIDAR, rays=given["scan"].shape[0])
    return Scout(known, goals, robot.limits if robot else LIMITS, context.recorder, lidar)
