"""Watches what the robot touches."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.simulation_run import Collision

SEPARATION_S = 0.1
"""A touch is over when nothing was felt for this long; shorter gaps are bouncing."""

MAX_REPORTED = 200

_MAX_QUIET = 1000
"""Lists of contacts without a collision that are remembered."""

_FLOOR_TOP_M = 0.012
"""Fixed things that rise no higher are driven over, not into: floors, rugs, thresholds."""

_ROBOT, _FLOOR = 1, 100


@dataclass
class _Touch:
    """A touch that may still go on."""

    first_s: float
    last_s: float
    x: float
    y: float
    max_force_N: float  # noqa: N815


class CollisionMonitor:
    """Turns contacts of the robot with anything but the floor into collisions.

    Call `sample` often: a touch that begins and ends between two calls is not seen, and the largest
    force is the largest of those sampled.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, robot_body_id: int, furniture_ids: Sequence[str] = ()
    ) -> None:
        """Looks up who is who.

        Args:
          model: the compiled world with the robot.
          data: its state, after `mj_forward`.
          robot_body_id: the robot's root body.
          furniture_ids: prefixes of geom names that name pieces of furniture.
        """
        self._model, self._data = model, data
        self._codes = _geom_codes(model, data, robot_body_id)
        self._names = [_describe(model, geom, furniture_ids) for geom in range(model.ngeom)]
        self._quiet: set[bytes] = set()
        self._open: dict[str, _Touch] = {}
        self._wrench = np.zeros(6)
        self.collisions: list[Collision] = []
        """Touches that are over, in order of their end; complete after `finish`; at most `MAX_REPORTED`."""
        self.count = 0
        """All touches so far, those that go on and those over the limit included."""
        self.max_force_N = 0.0

    def sample(self) -> None:
        """Looks at the present contacts."""
        pairs = self._data.contact.geom
        signature = pairs.tobytes()
        # The same few lists of pairs come again and again: wheels and a slide on the floor, what lies on what.
        if signature not in self._quiet:
            touching = np.flatnonzero(self._codes[pairs].sum(axis=1) == _ROBOT)
            if touching.size:
                self._note(pairs, touching)
            elif len(self._quiet) < _MAX_QUIET:
                self._quiet.add(signature)
        if self._open:
            self._close(self._data.time - SEPARATION_S)

    def finish(self) -> list[Collision]:
        """Ends the touches that still go on and returns all collisions by their beginning."""
        self._close(np.inf)
        return sorted(self.collisions, key=lambda collision: collision.time_s)

    def _note(self, pairs: NDArray[np.int32], touching: NDArray[np.intp]) -> None:
        forces: dict[str, float] = {}
        for index in touching.tolist():
            first, second = pairs[index].tolist()
            other = self._names[second if self._codes[first] == _ROBOT else first]
            mujoco.mj_contactForce(self._model, self._data, index, self._wrench)
            forces[other] = forces.get(other, 0.0) + abs(float(self._wrench[0]))
        now = self._data.time
        for other, force in forces.items():
            self.max_force_N = max(self.max_force_N, force)
            touch = self._open.get(other)
            if touch is None:
                self.count += 1
                x, y = self._robot_position()
                self._open[other] = _Touch(now, now, x, y, force)
            else:
                touch.last_s, touch.max_force_N = now, max(touch.max_force_N, force)

    def _robot_position(self) -> tuple[float, float]:
        body = self._model.geom_bodyid[int(np.flatnonzero(self._codes == _ROBOT)[0])]
        x, y, _ = self._data.xpos[body].tolist()
        return x, y

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


def _geom_codes(model: mujoco.MjModel, data: mujoco.MjData, robot_body_id: int) -> NDArray[np.int64]:
    """One number per geom, such that the two of a pair add up to `_ROBOT` for a collision only."""
    codes = np.zeros(model.ngeom, np.int64)
    codes[model.body_rootid[model.geom_bodyid] == model.body_rootid[robot_body_id]] = _ROBOT
    vertical = data.geom_xmat[:, 6:9]
    top = data.geom_xpos[:, 2] + np.einsum("ij,ij->i", vertical, model.geom_aabb[:, :3])
    top = top + np.einsum("ij,ij->i", np.abs(vertical), model.geom_aabb[:, 3:])
    plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    top = np.where(plane, data.geom_xpos[:, 2], top)
    codes[(model.geom_bodyid == 0) & (top <= _FLOOR_TOP_M)] = _FLOOR
    return codes


def _describe(model: mujoco.MjModel, geom_id: int, furniture_ids: Sequence[str]) -> str:
    """A geom's owner in a person's words: a furniture id, `wall`, else its body or itself."""
    name = model.geom(geom_id).name
    owners = [owner for owner in furniture_ids if name == owner or name.startswith((f"{owner}.", f"{owner}/"))]
    if owners:
        return max(owners, key=len)
    if name.startswith("wall"):
        return "wall"
    body = int(model.geom_bodyid[geom_id])
    return model.body(body).name if body else name or "unnamed"
