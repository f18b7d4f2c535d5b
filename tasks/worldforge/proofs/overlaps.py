"""Overlaps of solid parts, also of those that never move, between which MuJoCo has no contacts."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

_LEAST_M = 1e-4
"""Depth of an overlap below which bodies only touch, in metres."""


class Overlap(NamedTuple):
    """Two solid parts that overlap."""

    depth_m: float
    """How far one of them would have to be moved."""
    parts: tuple[str, str]
    """Names of the geoms."""


def find_overlaps(model: mujoco.MjModel, data: mujoco.MjData) -> list[Overlap]:
    """Finds all solid parts of different pieces that overlap, the deepest first.

    A piece is a body, a piece of furniture, or the whole building: its own parts are built into each other.

    Args:
        model: a world.
        data: where everything is; needs what `mj_kinematics` computes.
    """
    solid = (model.geom_contype | model.geom_conaffinity != 0) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    geoms = np.flatnonzero(solid)
    found: list[Overlap] = []
    for one, other in geoms[_near(model, data, geoms)].tolist():
        depth_m = -mujoco.mj_geomDistance(model, data, one, other, 0.0, None)
        if depth_m > _LEAST_M:
            found.append(Overlap(depth_m, (_name(model, one), _name(model, other))))
    return sorted(found, reverse=True)


def _near(model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.intp]) -> NDArray[np.intp]:
    """Pairs of places in `geoms` whose bounding boxes overlap: all that can, in a tenth of a millisecond."""
    axes, boxes = data.geom_xmat[geoms].reshape(-1, 3, 3), model.geom_aabb[geoms]
    center = data.geom_xpos[geoms] + (axes @ boxes[:, :3, None])[..., 0]
    half = (np.abs(axes) @ boxes[:, 3:, None])[..., 0]
    low, high = center - half + _LEAST_M, center + half
    pieces = _pieces(model, geoms)
    near = pieces[:, None] < pieces
    for axis in range(3):
        reaches = low[:, None, axis] < high[None, :, axis]
        near &= reaches & reaches.T
    return np.argwhere(near)


def _pieces(model: mujoco.MjModel, geoms: NDArray[np.intp]) -> NDArray[np.intp]:
    """The number of the piece that each geom is part of."""
    numbers: dict[tuple[int, str], int] = {}
    found: list[int] = []
    for geom, body in zip(geoms.tolist(), model.geom_bodyid[geoms].tolist(), strict=True):
        piece, dot, _ = _name(model, geom).partition(".")
        # What has no dot in its name is the building's.
        key = (body, piece if dot and body == 0 else "")
        found.append(numbers.setdefault(key, len(numbers)))
    return np.array(found, dtype=np.intp)


def _name(model: mujoco.MjModel, geom: int) -> str:
    """A geom's name; `model.geom` is twenty times slower."""
    begin = model.name_geomadr[geom]
    return model.names[begin : model.names.index(b"\0", begin)].decode()
