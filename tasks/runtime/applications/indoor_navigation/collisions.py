"""Records collisions of the robot with everything but the floor."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from .....schemas.runs.plan import Collision
from ...episode.contact_forces import ContactForces, can_touch, geom_names, robot_geoms
from ...episode.resumable import KeepsAttributes

SEPARATION_S = 0.1
"""A touch is over when nothing was felt for this long; shorter gaps are bouncing."""

MAX_REPORTED = 200


@dataclass
class _Touch:
    """A touch that may still go on."""

    first_s: float
    last_s: float
    x: float
    y: float
    max_force_N: float  # noqa: N815


class CollisionMonitor(KeepsAttributes):
    """Turns contacts of the robot with anything but the floor into collisions.

    Call `sample` often: a touch that begins and ends between two calls is not seen, and the largest
    force is the largest of those sampled.
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
        """Looks up the bodies and geoms.

        Args:
            model: the compiled world with the robot.
            data: its state, after `mj_forward`.
            robot_body_id: the robot's root body.
            furniture_ids: prefixes of geom names that name pieces of furniture.
            on_touch: called at every look at which something is touched.
        """
        self._data = data
        self._on_touch = on_touch
        self._position = data.xpos[robot_body_id]
        robot = robot_geoms(model, robot_body_id)
        self.can_touch = can_touch(model, robot)
        """Whether the robot has a shape that collides with anything else."""
        self._contacts = ContactForces(model, data, robot, geom_names(model, furniture_ids))
        self._open: dict[str, _Touch] = {}
        self.collisions: list[Collision] = []
        """Touches that are over, in order of their end; complete after `finish`; at most `MAX_REPORTED`."""
        self.count = 0
        """All touches so far, those that go on and those over the limit included."""
        self.max_force_N = 0.0

    def sample(self) -> None:
        """Looks at the present contacts."""
        if forces := self._contacts.read():
            self._note(forces)
            if self._on_touch is not None:
                self._on_touch()
        if self._open:
            self._close(self._data.time - SEPARATION_S)

    def finish(self) -> list[Collision]:
        """Ends the touches that still go on and returns all collisions by their beginning."""
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
