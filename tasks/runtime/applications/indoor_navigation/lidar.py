"""Range sensors: the planar lidar on top and the proximity sensors in the bumper."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np
from numpy.typing import NDArray

from .level_scan import Fan, LevelScan

PROXIMITY_ANGLES_RAD = np.linspace(-np.pi / 3, np.pi / 3, 15)
PROXIMITY_RANGE_MAX_M = 0.8

_VISIBLE_GROUPS = (0, 1, 2)
"""Geom groups that MuJoCo renders by default."""


class RangeFinder:
    """Simulated lidar with rays around a robot's vertical axis, which do not hit the robot's own root body.

    The rays turn and tilt with the robot. While the robot is level, full scans are computed on the floor plan of the
    world, which is several times faster than ray casting.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        body_id: int,
        height_m: float,
        angles_rad: NDArray[np.float64],
        range_max_m: float,
        hidden_group: int | None = None,
    ) -> None:
        """Prepares a simulated lidar, with memory for its measurements.

        Args:
            model: The compiled world with the robot.
            data: State of the model, read at every measurement.
            body_id: The robot's root body; rays start on its z axis.
            height_m: Height of the rays' origin on the body's z axis.
            angles_rad: Directions of the rays, counter-clockwise from the robot's x axis.
            range_max_m: Range of the lidar; farther surfaces are not measured.
            hidden_group: Geom group that no ray can hit, from `hide_geoms_from_lidar`.
        """
        self._model, self._data, self._body_id = model, data, body_id
        self._rotation = data.xmat[body_id].reshape(3, 3)
        self._position = data.xpos[body_id]
        self._offset = np.array([0.0, 0.0, height_m])
        self._directions = np.stack((np.cos(angles_rad), np.sin(angles_rad), np.zeros_like(angles_rad)), axis=1)
        self._range_max_m = range_max_m
        self._geom_ids = np.zeros(len(angles_rad), np.int32)
        self._distances = np.zeros(len(angles_rad))
        self._groups = np.ones(mujoco.mjNGROUP, np.uint8)
        if hidden_group is not None:
            self._groups[hidden_group] = 0
        self._level = self._level_scan(height_m, angles_rad)

    def measure(self) -> NDArray[np.float64]:
        """Measures distances in metres, one for each ray, infinite where nothing is in range."""
        distances = self._level.measure() if self._level else None
        return self.cast() if distances is None else distances

    def cast(self) -> NDArray[np.float64]:
        """Measures the distances of all rays in metres with MuJoCo's ray casting, infinite without a hit in range.

        It handles every shape and tilt, but is slower than the scan for level robots.
        """
        origin = self._position + self._rotation @ self._offset
        rays = self._directions @ self._rotation.T
        mujoco.mj_multiRay(
            self._model, self._data, origin, rays.ravel(), self._groups, True, self._body_id,
            self._geom_ids, self._distances, None, len(rays), self._range_max_m,
        )  # fmt: skip
        seen = (self._distances >= 0) & (self._distances <= self._range_max_m)
        return np.where(seen, self._distances, np.inf)

    def _level_scan(self, height_m: float, angles_rad: NDArray[np.float64]) -> LevelScan | None:
        """Returns the faster lidar for level robots, or `None` if these rays or this world do not allow it.

        The rays have to be evenly spaced all around, and no geom may be endless.
        """
        fan = Fan(len(angles_rad), float(angles_rad[0]))
        around = np.abs(fan.directions - np.exp(1j * angles_rad)).max() < 1e-9
        if not around:
            return None
        try:
            return LevelScan(self._model, self._data, self._body_id, height_m, fan, self._range_max_m, self._groups)
        except ValueError:  # something without an end, such as a plane that leans
            return None


def hide_geoms_from_lidar(
    model: mujoco.MjModel, data: mujoco.MjData, height_m: float, tolerance_m: float
) -> int | None:
    """Moves fixed geoms that no lidar ray can hit to a separate geom group, so that ray casting is faster.

    MuJoCo tests every geom for every ray, and most geoms can never be hit: those above or below the lidar's plane
    (table tops, lintels, drawer fronts), and those that are drawn but do not collide. Only geoms of rendered groups are
    moved, into a rendered group that the world does not use, so that pictures stay the same.

    Args:
        model: Compiled model, whose `geom_group` is changed in place.
        data: A state of it, after `mj_forward`.
        height_m: Height of the lidar's plane over the floor.
        tolerance_m: Change of the plane's height at the sensor's range when the robot tilts.

    Returns:
        The group, or `None` if the world uses all of them; nothing is moved then.
    """
    unused = [group for group in _VISIBLE_GROUPS if group not in model.geom_group]
    if not unused:
        return None
    vertical = data.geom_xmat[:, 6:9]
    middle = data.geom_xpos[:, 2] + np.einsum("ij,ij->i", vertical, model.geom_aabb[:, :3])
    reach = np.einsum("ij,ij->i", np.abs(vertical), model.geom_aabb[:, 3:])
    finite = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    off_plane = finite & (np.abs(middle - height_m) > reach + tolerance_m)
    drawn_only = (model.geom_contype == 0) & (model.geom_conaffinity == 0)
    fixed = model.geom_bodyid == 0
    shown = np.isin(model.geom_group, _VISIBLE_GROUPS)
    model.geom_group[fixed & shown & (off_plane | drawn_only)] = unused[-1]
    return unused[-1]
