"""Rays into a compiled world, cast by MuJoCo: cameras, and the places that their rays hit."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import cos, radians, sin, tan
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..geometry.parts import Vector

Array = NDArray[np.floating[Any]]
Ids = NDArray[np.int32]
Flags = NDArray[np.bool_]

_CUTOFF_M = 80.0
"""Greatest length of a ray, in metres: far beyond the largest building."""
_HIDDEN_GROUP, _GLASS_GROUP = 3, 5
_ON_PLANE_M = 0.003
"""Distance up to which something that stands out of a plane is part of it, in metres."""


@dataclass(frozen=True, slots=True)
class Camera:
    """Position, direction and field of view of a camera."""

    place: Vector
    """Position of the camera in the world, in metres."""
    yaw: float
    """Direction of view in radians: 0 is east, pi/2 north."""
    pitch: float
    """Angle of the direction of view above the horizon, in radians."""
    fov_deg: float
    """Angle of view from left to right, in degrees."""
    drop: float = 0.0
    """Distance of the picture's middle below the direction of view, over that to the picture. A lens that is moved
    down, as photographers of buildings do it, sees more floor and keeps upright edges upright."""
    front: tuple[Vector, Vector] | None = None
    """A place on a plane and its normal, ahead: the camera does not see what is on its own side of the plane."""

    def rays(self, width: int, height: int, columns: Array, rows: Array) -> Array:
        """Returns unit direction vectors through pixel positions, shape (n, 3)."""
        reach = tan(radians(self.fov_deg) / 2)
        right = (columns + 0.5 - width / 2) * (2 * reach / width)
        down = (rows + 0.5 - height / 2) * (2 * reach / width) + self.drop
        c, s, up, flat = cos(self.yaw), sin(self.yaw), sin(self.pitch), cos(self.pitch)
        ahead, side, over = (
            np.array([c * flat, s * flat, up]),
            np.array([s, -c, 0.0]),
            np.array([-c * up, -s * up, flat]),
        )
        rays = ahead + right[:, None] * side - down[:, None] * over
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)


@dataclass(frozen=True, slots=True)
class Hits:
    """Points where rays hit geoms, with geom ids and normals."""

    geoms: Ids
    """Id of the geom that each ray hits; -1 for nothing."""
    places: Array
    """Place that each ray hits, in metres, shape (n, 3); a metre away where it hits nothing."""
    normals: Array

    def __getitem__(self, chosen: Any) -> "Hits":
        return Hits(self.geoms[chosen], self.places[chosen], self.normals[chosen])


class RayCaster:
    """Casts rays into a compiled world in its first state.

    Args:
        model: The world; its groups of geoms change: panes of glass come into one of their own.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        mujoco.mj_forward(model, self._data)
        alpha = model.geom_rgba[:, 3]
        if model.nmat:
            alpha = np.where(model.geom_matid >= 0, model.mat_rgba[model.geom_matid, 3], alpha)
        self._is_glass = (alpha < 0.99) & (model.geom_group < _HIDDEN_GROUP)
        model.geom_group[self._is_glass] = _GLASS_GROUP
        self._near_sides: dict[tuple[float, ...], Flags] = {}
        self._seen = np.array([1, 1, 1, 0, 1, 0], np.uint8)
        self._glass = np.array([0, 0, 0, 0, 0, 1], np.uint8)

    @property
    def has_glass(self) -> bool:
        """Whether the world has panes that one sees through."""
        return bool(self._is_glass.any())

    def trace(self, origin: Vector, rays: Array, groups: NDArray[np.uint8] | None = None) -> tuple[Ids, Array, Array]:
        """Casts rays from one point; returns geom (-1: no hit), distance in metres and normal of each ray.

        `groups` has a 1 for each geom group that rays may hit; `None`: those that pictures show, without glass.
        """
        count = len(rays)
        geoms, distances = np.full(count, -1, np.int32), np.full(count, -1.0)
        normals = np.zeros(3 * count)
        visible = self._seen if groups is None else groups
        mujoco.mj_multiRay(
            self._model, self._data, np.array(origin, float), np.ascontiguousarray(rays, float).ravel(), visible,
            True, -1, geoms, distances, normals, count, _CUTOFF_M,
        )  # fmt: skip
        return geoms, distances, normals.reshape(-1, 3)

    def hits(self, origin: Vector, rays: Array) -> Hits:
        """Returns the places that rays from one point hit, with normals that look back at the point."""
        geoms, distances, normals = self.trace(origin, rays)
        normals[np.sum(normals * rays, axis=1) > 0] *= -1
        return Hits(geoms, np.array(origin) + rays * np.where(geoms < 0, 1.0, distances)[:, None], normals)

    def through_glass(self, origin: Vector, rays: Array, hits: Hits) -> Array:
        """Returns 1 for rays that go through glass before they hit something, or hit nothing; 0 for others."""
        if not self.has_glass or len(rays) == 0:
            return np.zeros(len(rays))
        panes, near, _ = self.trace(origin, rays, self._glass)
        distances = np.linalg.norm(hits.places - np.array(origin), axis=1)
        return ((panes >= 0) & ((hits.geoms < 0) | (near < distances))).astype(float)

    @contextmanager
    def beyond(self, place: Array, normal: Array) -> Iterator[None]:
        """Lets rays go through everything that is on the far side of a plane for a while.

        Args:
            place: A place on the plane.
            normal: Unit vector towards the side that stays.
        """
        key = (*np.round(normal, 6).tolist(), round(float(place @ normal), 6))
        if key not in self._near_sides:
            self._near_sides[key] = self._stand_out(place, normal) < _ON_PLANE_M
        with self.without(self._near_sides[key]):
            yield

    def _stand_out(self, place: Array, normal: Array) -> NDArray[Any]:
        """Returns the distance in metres by which each geom stands out of a plane, towards its normal.

        It is negative for a geom that lies behind the plane.
        """
        turns = self._data.geom_xmat.reshape(-1, 3, 3)
        box = self._model.geom_aabb
        middle = self._data.geom_xpos + np.einsum("gij,gj->gi", turns, box[:, :3])
        reach = np.abs(np.einsum("gij,i->gj", turns, normal))
        top = (middle - place) @ normal + np.sum(reach * box[:, 3:], axis=1)
        is_plane = self._model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        return np.where(is_plane, (self._data.geom_xpos - place) @ normal, top)

    @contextmanager
    def without(self, geoms: NDArray[Any]) -> Iterator[None]:
        """Lets rays go through some geoms for a while.

        Args:
            geoms: Their numbers, or which of all they are.
        """
        groups = self._model.geom_group.copy()
        try:
            self._model.geom_group[geoms] = _HIDDEN_GROUP
            yield
        finally:
            self._model.geom_group[:] = groups
