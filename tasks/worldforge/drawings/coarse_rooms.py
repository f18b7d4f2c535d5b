"""Straightens the rooms of ragged lidar maps: outlines follow the few lines that most walls run near.

A lidar's walls are bumpy, and have gaps. The borders of rooms vote for lines; each field
between lines then belongs to the room that has most of its cells. So neighbours share lines, and nothing overlaps.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..floorplans.brief import EXTERIOR_WALL
from ..floorplans.partition import UNITS_PER_M

_WALL_M = 0.2
"""Largest distance of a room's border from the line it is moved to, in metres.

It is half the thickest wall, and bumps of a lidar.
"""
_APART_M = 0.45
"""Smallest distance between two lines of room borders, in metres: less is a niche, a pillar or noise."""
_LEAST_LINE_M = 0.8
"""Smallest length of room border that makes a line, in metres: furniture has less of it."""
_OUTER_SHARE = 0.8
"""Share of a line's border that has the room on the same side, above which the line is an outer wall."""
_HALF = 0.5
"""Share of the cells of a field between border lines that a room needs to get the field."""

Regions = NDArray[np.int64]


def coarse_rooms(regions: Regions, resolution_m: float) -> Regions:
    """Straightens rooms, so that all of their edges lie on common lines.

    Args:
        regions: Number of the room that each cell belongs to, from 1; 0 for none.
        resolution_m: Side of a cell.

    Returns:
        The same with straight edges; a room without any field of its own is in it no more.
    """
    rooms = int(regions.max(initial=0))
    filled = _without_holes(regions, rooms)
    upright, level = (_lines(filled if axis == 0 else filled.T, resolution_m) for axis in (0, 1))
    made = np.zeros_like(regions)
    if len(upright) < 2 or len(level) < 2:
        return made
    fields = [_fields(filled == number, upright, level) for number in range(1, rooms + 1)]
    share = np.stack(fields)
    owner = np.where(share.max(axis=0) >= _HALF, share.argmax(axis=0) + 1, 0)
    for number in range(1, rooms + 1):
        for row, column in np.argwhere(_largest(owner == number)):
            made[level[row] : level[row + 1], upright[column] : upright[column + 1]] = number
    return made


def _without_holes(regions: Regions, rooms: int) -> Regions:
    filled = regions.copy()
    for number in range(1, rooms + 1):
        inside = np.asarray(ndimage.binary_fill_holes(regions == number))
        filled[inside & (filled == 0)] = number
    return filled


def _lines(regions: Regions, resolution_m: float) -> list[int]:
    """Returns the grid columns near which most vertical room borders are, from west to east."""
    padded = np.pad(regions, ((0, 0), (1, 1)))
    differs = padded[:, 1:] != padded[:, :-1]
    begins = np.count_nonzero(differs & (padded[:, 1:] > 0), axis=0).astype(np.float64)
    ends = np.count_nonzero(differs & (padded[:, :-1] > 0), axis=0).astype(np.float64)
    border = begins + ends
    near, apart = max(1, round(_WALL_M / resolution_m)), round(_APART_M / resolution_m)
    left = border.copy()
    found: list[int] = []
    while True:
        votes = np.convolve(left, np.ones(2 * near + 1), "same")
        # Ties, as of straight borders, go to the middle of the columns that have them.
        best = np.flatnonzero(votes == votes.max())
        at = int(best[len(best) // 2])
        if votes[at] * resolution_m < _LEAST_LINE_M:
            return sorted(found)
        window = slice(max(0, at - near), at + near + 1)
        middle = round(float(np.average(np.arange(len(left))[window], weights=left[window])))
        if all(abs(middle - other) >= apart for other in found):
            found.append(_outer(middle, begins[window].sum(), ends[window].sum(), len(left) - 1, resolution_m))
        left[window] = 0


def _outer(at: int, begins: float, ends: float, last: int, resolution_m: float) -> int:
    """Returns the centre column of an outer wall, of which the map shows only the inner face.

    Other lines stay unchanged.
    """
    off = round(EXTERIOR_WALL / 2 / UNITS_PER_M / resolution_m)
    if begins >= _OUTER_SHARE * (begins + ends):
        return max(0, at - off)
    return min(last, at + off) if ends >= _OUTER_SHARE * (begins + ends) else at


def _fields(cells: NDArray[np.bool_], upright: Sequence[int], level: Sequence[int]) -> NDArray[np.float64]:
    """Returns the share of each field between the border lines that belongs to a room."""
    total = np.pad(cells.cumsum(0, dtype=np.int64).cumsum(1), ((1, 0), (1, 0)))
    corners = total[np.ix_(level, upright)]
    count = corners[1:, 1:] - corners[:-1, 1:] - corners[1:, :-1] + corners[:-1, :-1]
    return count / np.outer(np.diff(level), np.diff(upright))


def _largest(fields: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns a mask of the largest connected part of a room on a map."""
    labels: Regions = np.asarray(ndimage.label(fields)[0]).astype(np.int64)  # pyright: ignore[reportIndexIssue]
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return labels == sizes.argmax() if sizes.any() else fields
