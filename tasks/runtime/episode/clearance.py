"""Clearance of the robot: its distance from everything else."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

_FAR_M = 1e6


class ClearanceMeter:
    """Measures the smallest distance between the surfaces of the robot and of other things.

    `mj_geomDistance` measures pairs of geoms exactly. Few pairs are asked for: the other geoms are taken in the
    order of how near their bounding boxes come to a ball around the robot, until none can be nearer any more.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: NDArray[np.bool_],
        others: NDArray[np.bool_],
        names: Sequence[str],
    ) -> None:
        """Prepares the measurement.

        Args:
            model: The compiled world with the robot.
            data: Its state, after `mj_forward`.
            robot: Which geoms are the robot's.
            others: Which geoms to stay away from.
            names: What each geom is called.
        """
        self._model, self._data, self._names = model, data, names
        solid = _collides(model, robot)
        others = others & solid
        # A robot whose geoms touch nothing at all is measured by what can be seen of it.
        body = robot & _collides(model, others) if others.any() else robot
        self._robot = np.flatnonzero(body if body.any() else robot)
        self._others = np.flatnonzero(others)
        self._centre, self._half = model.geom_aabb[self._others, :3], model.geom_aabb[self._others, 3:]
        self._radii = model.geom_rbound[self._robot]

    @property
    def has_others(self) -> bool:
        """Whether there is anything to stay away from."""
        return self._others.size > 0 and self._robot.size > 0

    def measure(self, below_m: float = _FAR_M) -> tuple[float, str] | None:
        """Returns the smallest distance in m, negative for an overlap, and what is so near.

        Args:
            below_m: Larger distances do not matter; the smaller it is, the faster the answer.

        Returns:
            None when nothing is nearer than `below_m`.
        """
        if not self.has_others:
            return None
        model, data, robot = self._model, self._data, self._robot.tolist()
        bounds = self._lower_bounds()
        nearest, other = min(below_m, _FAR_M), -1
        candidates = np.flatnonzero(bounds < nearest)
        for index in candidates[np.argsort(bounds[candidates])].tolist():
            if bounds[index] >= nearest:
                break
            geom = int(self._others[index])
            for part in robot:
                distance = mujoco.mj_geomDistance(model, data, part, geom, nearest, None)
                if distance < nearest:
                    nearest, other = distance, geom
        return None if other < 0 else (nearest, self._names[other])

    def _lower_bounds(self) -> NDArray[np.float64]:
        """No geom is nearer to the robot than this: from a ball around the robot to the geom's bounding box."""
        positions = self._data.geom_xpos[self._robot]
        middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
        radius = float((np.linalg.norm(positions - middle, axis=1) + self._radii).max())
        away = middle - self._data.geom_xpos[self._others]
        axes = self._data.geom_xmat[self._others].reshape(-1, 3, 3)
        local = np.einsum("nij,ni->nj", axes, away) - self._centre
        gap = np.maximum(np.abs(local) - self._half, 0.0)
        # Penetrating geoms have no bound: the deepest is to be found.
        distance = np.sqrt(np.einsum("nj,nj->n", gap, gap)) - radius
        return np.where(distance <= 0, -np.inf, distance)


def _collides(model: mujoco.MjModel, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns a mask of the geoms that can touch one of some; geoms that are only to be seen do not count."""
    kinds = int(np.bitwise_or.reduce(model.geom_contype[some], initial=0))
    partners = int(np.bitwise_or.reduce(model.geom_conaffinity[some], initial=0))
    return (model.geom_contype & partners != 0) | (model.geom_conaffinity & kinds != 0)
