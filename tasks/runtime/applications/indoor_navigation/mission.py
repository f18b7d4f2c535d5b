"""Score of indoor navigation: visited rooms, collisions, and the run's report."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from .....schemas.runs.plan import Collision, Requirement, RoomVisit
from .....schemas.runs.requirement_kinds.off import NO_HARD_COLLISION, ROOMS_VISITED, UPRIGHT
from .....schemas.wire.common import counted
from .....schemas.worlds.world import Room, bounds, contains
from ...episode.context import KeepsAttributes
from ...episode.physics import ContactForces, can_touch, geom_names, robot_geoms
from ...episode.run_results import MAX_PATH_POINTS, EnvironmentReport, thin_out
from .telemetry import RobotState

HARD_COLLISION_N = 20.0
"""Normal force in N above which a contact counts as a crash: Scout's bumper reaches it at about 0.12 m/s against a
wall.
"""

TIPPED_OVER_RAD = math.radians(35)


_PATH_PERIOD_S = 0.2


class Mission(KeepsAttributes):
    """Progress of a robot that has to visit every room within a time limit, and the verdict on it; has checkpoints."""

    KEPT = ("_unvisited", "first_visit_s", "tipped_over", "_distance_m", "_path", "_last")

    def __init__(self, rooms: Sequence[Room], time_limit_s: float) -> None:
        """Creates a mission in which no room is visited.

        Args:
            rooms: The rooms to visit, in any order.
            time_limit_s: Simulated time that ends the run.
        """
        self._rooms = rooms
        self._unvisited = {index: (bounds(room.polygon), room.polygon) for index, room in enumerate(rooms)}
        self.time_limit_s = time_limit_s
        self.first_visit_s: list[float | None] = [None] * len(rooms)
        self.tipped_over = False
        self._distance_m = 0.0
        self._path: list[tuple[float, float, float]] = []
        self._last: RobotState | None = None

    @property
    def visited_count(self) -> int:
        """Number of rooms the robot has been in."""
        return len(self._rooms) - len(self._unvisited)

    @property
    def all_visited(self) -> bool:
        """Whether the robot has been in every room."""
        return not self._unvisited

    def update(self, state: RobotState, tilt_rad: float) -> int:
        """Records the robot's state: path, tilt and visited rooms.

        Args:
            state: The state now.
            tilt_rad: Angle between the robot's axis and the vertical.

        Returns:
            Number of rooms that were entered for the first time.
        """
        self.tipped_over |= tilt_rad > TIPPED_OVER_RAD
        if self._last is not None:
            self._distance_m += math.hypot(state.x - self._last.x, state.y - self._last.y)
        self._last = state
        if not self._path or state.time_s - self._path[-1][0] >= _PATH_PERIOD_S - 1e-6:
            self._path.append((round(state.time_s, 3), round(state.x, 4), round(state.y, 4)))
        x, y = state.x, state.y
        entered = [
            index
            for index, ((west, south, east, north), polygon) in self._unvisited.items()
            if west <= x <= east and south <= y <= north and contains(polygon, x, y)
        ]
        for index in entered:
            self.first_visit_s[index] = round(state.time_s, 3)
            del self._unvisited[index]
        return len(entered)

    def report(
        self,
        collisions: list[Collision],
        touches: int,
        max_force_N: float,  # noqa: N803
        *,
        can_touch: bool = True,
    ) -> EnvironmentReport:
        """Computes verdict, requirements and metrics of the run.

        Args:
            collisions: Collisions to list in the report.
            touches: Number of all collisions.
            max_force_N: Largest contact force.
            can_touch: Whether the robot has a geom that can collide with anything else.
        """
        time_s = self._last.time_s if self._last else 0.0
        requirements = self._requirements(time_s, max_force_N)
        if not can_touch:
            requirements = [_never_touches(item) if item.name == NO_HARD_COLLISION else item for item in requirements]
        missed = [requirement for requirement in requirements if not requirement.satisfied]
        progress = f"{self.visited_count} of {counted(len(self._rooms), 'room')} visited in {time_s:.1f} s"
        return EnvironmentReport(
            verdict="FAIL" if missed else "PASS",
            summary=f"{progress}; failed: {'; '.join(item.detail for item in missed)}." if missed else f"{progress}.",
            requirements=requirements,
            metrics={
                "sim_time_s": round(time_s, 3),
                "distance_m": round(self._distance_m, 3),
                "mean_speed_mps": round(self._distance_m / time_s, 4) if time_s else 0.0,
                "rooms": float(len(self._rooms)),
                "rooms_visited": float(self.visited_count),
                "collisions": float(touches),
                "max_collision_force_N": round(max_force_N, 2),
            },
            rooms=[
                RoomVisit(name=room.name, visited=time_s is not None, first_visit_s=time_s)
                for room, time_s in zip(self._rooms, self.first_visit_s, strict=True)
            ],
            collisions=collisions,
            path=thin_out(self._path, MAX_PATH_POINTS),
        )

    def _requirements(self, time_s: float, max_force_N: float) -> list[Requirement]:  # noqa: N803
        unseen = [room.name for room, at in zip(self._rooms, self.first_visit_s, strict=True) if at is None]
        # Time is no requirement of its own: a job that switches `rooms_visited` off has no rooms to be in time for.
        late = f"; the time limit of {self.time_limit_s:g} s was reached" if time_s >= self.time_limit_s - 1e-6 else ""
        rooms = counted(len(self._rooms), "room")
        return [
            Requirement(
                name=ROOMS_VISITED,
                satisfied=not unseen,
                detail=f"not visited: {', '.join(unseen)}{late}" if unseen else f"all {rooms} visited",
            ),
            Requirement(
                name=NO_HARD_COLLISION,
                satisfied=max_force_N <= HARD_COLLISION_N,
                detail=f"hardest touch {max_force_N:.1f} N, at most {HARD_COLLISION_N:g} N allowed",
            ),
            Requirement(
                name=UPRIGHT,
                satisfied=not self.tipped_over,
                detail="the robot tipped over" if self.tipped_over else "the robot stayed upright",
            ),
        ]


def _never_touches(requirement: Requirement) -> Requirement:
    why = "the robot has no shape that collides with anything else, so it goes through everything"
    return requirement.model_copy(update={"satisfied": False, "error": why, "detail": f"could not be judged: {why}"})


SEPARATION_S = 0.1
"""Seconds without contact after which a collision is over; shorter gaps are bouncing."""

MAX_REPORTED = 200


@dataclass
class _Touch:
    """A collision of the robot that may still go on: its first and last time (s), place (m) and largest force (N)."""

    first_s: float
    last_s: float
    x: float
    y: float
    max_force_N: float  # noqa: N815


class CollisionMonitor(KeepsAttributes):
    """Detects collisions of the robot with anything but the floor from simulated contacts.

    Call `sample` often: a collision that begins and ends between two calls is not detected, and the maximum force is
    that of the samples.
    """

    KEPT = ("_open", "collisions", "count", "max_force_N")

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot_body_id: int,
        furniture_ids: Sequence[str] = (),
        on_touch: Callable[[], None] | None = None,
    ) -> None:
        """Looks up the robot's bodies and geoms, whose collisions are detected from now on.

        Args:
            model: The compiled world with the robot.
            data: State of the model, after `mj_forward`.
            robot_body_id: The robot's root body.
            furniture_ids: Prefixes of geom names that name pieces of furniture.
            on_touch: Called at every sample in which the robot has a contact.
        """
        self._data = data
        self._on_touch = on_touch
        self._position = data.xpos[robot_body_id]
        robot = robot_geoms(model, robot_body_id)
        self.can_touch = can_touch(model, robot)
        """Whether the robot has a geom that collides with anything else."""
        self._contacts = ContactForces(model, data, robot, geom_names(model, furniture_ids))
        self._open: dict[str, _Touch] = {}
        self.collisions: list[Collision] = []
        """Finished collisions in order of their end, at most `MAX_REPORTED`; complete after `finish`."""
        self.count = 0
        """Number of all collisions so far, including current ones and those over the limit."""
        self.max_force_N = 0.0

    def sample(self) -> None:
        """Records the robot's current contacts: begins and extends collisions, and ends those separated for long."""
        if forces := self._contacts.read():
            self._note(forces)
            if self._on_touch is not None:
                self._on_touch()
        if self._open:
            self._close(self._data.time - SEPARATION_S)

    def finish(self) -> list[Collision]:
        """Ends the current collisions, and returns all collisions in order of their beginning."""
        self._close(np.inf)
        return sorted(self.collisions, key=lambda collision: collision.time_s)

    def _note(self, forces: dict[str, float]) -> None:
        now = self._data.time
        for other, force in forces.items():
            self.max_force_N = max(self.max_force_N, force)
            touch = self._open.get(other)
            if touch is None:
                self.count += 1
                x, y, _ = self._position.tolist()
                self._open[other] = _Touch(now, now, x, y, force)
            else:
                touch.last_s, touch.max_force_N = now, max(touch.max_force_N, force)

    def _close(self, before_s: float) -> None:
        for other in [other for other, touch in self._open.items() if touch.last_s < before_s]:
            touch = self._open.pop(other)
            if len(self.collisions) < MAX_REPORTED:
                self.collisions.append(
                    Collision(
                        time_s=round(touch.first_s, 3), duration_s=round(touch.last_s - touch.first_s, 3),
                        x=round(touch.x, 3), y=round(touch.y, 3), other=other, max_force_N=round(touch.max_force_N, 2),
                    )
                )  # fmt: skip
