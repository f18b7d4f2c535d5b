"""Paths through a room that stay open for a robot while furniture is placed."""

from collections import Counter
from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ....schemas.worlds.world import Point
from ..geometry.boxes import Box

_CELL_M = 0.05
_FOUR_NEIGHBOURS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])
_GATE_REACH = 6
"""Distance from a door, in cells, at which a path to it may end where a wall or an open door is too near."""

_LARGEST_POCKETS = 0.06
"""Share of a room's free cells that furniture may cut off, such as the gap behind a sofa."""


class Ways:
    """Grid of the cells in a room where a robot's centre can be, to keep doors connected while furnishing.

    The cells are stored with a border of cells that nothing may be in, so that every block has cells all
    around it.
    """

    def __init__(self, bounds: Box, half_width_m: float, solids: Sequence[Box], outside: Sequence[Box]) -> None:
        """Makes the grid of an empty room.

        Args:
            bounds: The room's extent.
            half_width_m: Half the width of the paths.
            solids: Walls, which keep the middle of a robot at that distance.
            outside: Parts of the extent that are outside the room.
        """
        self._x0, self._y0, x1, y1 = bounds
        self._half_m = half_width_m
        self._free = np.zeros((ceil((y1 - self._y0) / _CELL_M) + 2, ceil((x1 - self._x0) / _CELL_M) + 2), np.bool_)
        self._free[1:-1, 1:-1] = True
        for box in outside:
            self._free[self._slices(box, 0.0)] = False
        for box in solids:
            self._free[self._slices(box, half_width_m)] = False
        self._gates: list[tuple[int, int]] = []
        self._open: NDArray[np.bool_] | None = None
        self._most_lost = 0.0

    def join(self, gates: Sequence[Point]) -> None:
        """Sets the points (doors) between which paths through the room must exist; called once, at first."""
        rows, columns = self._free.shape
        for x, y in gates:
            row, column = int((y - self._y0) / _CELL_M) + 1, int((x - self._x0) / _CELL_M) + 1
            self._gates.append(self._nearest_free(min(max(row, 1), rows - 2), min(max(column, 1), columns - 2)))
        self._open = self._component(self._free)
        cells = int(np.count_nonzero(self._free))
        cut_off = 0 if self._open is None else cells - int(np.count_nonzero(self._open))
        self._most_lost = cut_off + _LARGEST_POCKETS * cells

    @property
    def joined(self) -> bool:
        """Whether all doors of the room (the points of `join`) are connected by paths."""
        return self._open is not None

    def _nearest_free(self, row: int, column: int) -> tuple[int, int]:
        """Returns the free cell nearest to a cell; the cell itself if it is free, or no free one is near."""
        if self._free[row, column]:
            return row, column
        south, west = max(row - _GATE_REACH, 0), max(column - _GATE_REACH, 0)
        rows, columns = np.nonzero(self._free[south : row + _GATE_REACH + 1, west : column + _GATE_REACH + 1])
        if not len(rows):
            return row, column
        best = int(((rows + south - row) ** 2 + (columns + west - column) ** 2).argmin())
        return int(rows[best]) + south, int(columns[best]) + west

    def stays_open(self, *boxes: Box) -> bool:
        """Whether all doors stay connected if more rectangles of the floor are blocked.

        It is false if doors are not connected already, and if too much free floor would be cut off.
        """
        if self._open is None:
            return False
        blocks = [self._slices(box, self._half_m) for box in boxes]
        if any(
            rows.start <= row < rows.stop and columns.start <= column < columns.stop
            for rows, columns in blocks
            for row, column in self._gates
        ):
            return False
        if len(blocks) == 1 and self._rim_is_whole(*blocks[0]):
            return True
        free = self._free.copy()
        for rows, columns in blocks:
            free[rows, columns] = False
        component = self._component(free)
        return component is not None and int(free.sum()) - int(component.sum()) <= self._most_lost

    def block(self, box: Box) -> None:
        """Blocks the floor cells that a robot cannot reach any more because of a rectangle."""
        rows, columns = self._slices(box, self._half_m)
        whole = self._rim_is_whole(rows, columns)
        self._free[rows, columns] = False
        if self._open is None:
            return
        if whole:
            self._open = self._open & self._free
        else:
            self._open = self._component(self._free)

    def margins(self) -> list[Point]:
        """Returns the centres of the floor cells that no robot can be in, inside the room's extent."""
        rows, columns = np.nonzero(~self._free[1:-1, 1:-1])
        x, y = self._x0 + (columns + 0.5) * _CELL_M, self._y0 + (rows + 0.5) * _CELL_M
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def nearest(self, point: Point) -> Point:
        """Returns the centre of the free cell nearest to a point.

        If not all doors are connected, cells connected with most of the doors count.
        """
        cells = self._best_part() if self._open is None else self._open
        if not cells.any():
            return point
        rows, columns = np.nonzero(cells)
        x, y = self._x0 + (columns - 0.5) * _CELL_M, self._y0 + (rows - 0.5) * _CELL_M
        best = int(np.argmin((x - point[0]) ** 2 + (y - point[1]) ** 2))
        return round(float(x[best]), 3), round(float(y[best]), 3)

    def _best_part(self) -> NDArray[np.bool_]:
        """Returns a mask of the free cells that are connected with most of the doors, or the largest connected part."""
        labels = np.asarray(ndimage.label(self._free, _FOUR_NEIGHBOURS)[0])  # pyright: ignore[reportIndexIssue]
        found = Counter(int(labels[gate]) for gate in self._gates if labels[gate])
        if not found:
            found = Counter(labels[labels > 0].tolist())
        return labels == (found.most_common(1)[0][0] if found else -1)

    def _rim_is_whole(self, rows: slice, columns: slice) -> bool:
        """Whether the free cells around a block are connected along its rim.

        If they are, a robot that passed through the block can drive around it, and nothing is cut off: the common case,
        decided without examining the whole room.
        """
        top, bottom, left, right = rows.start - 1, rows.stop, columns.start - 1, columns.stop
        if top >= bottom - 1 or left >= right - 1:
            return True
        free = self._free
        rim = (
            free[top, left : right + 1].tobytes()
            + free[rows, right].tobytes()
            + free[bottom, left : right + 1][::-1].tobytes()
            + free[rows, left][::-1].tobytes()
        )
        runs = rim.count(b"\0\1") + (rim[-1] == 0 and rim[0] == 1)
        return runs <= 1

    def _component(self, free: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
        """Returns a mask of the free cells connected with all doors; `None` if the doors are not connected."""
        labels = np.asarray(ndimage.label(free, _FOUR_NEIGHBOURS)[0])  # pyright: ignore[reportIndexIssue]
        found = {int(labels[gate]) for gate in self._gates}
        if len(found) != 1 or 0 in found:
            return None
        return labels == found.pop()

    def _slices(self, box: Box, margin: float) -> tuple[slice, slice]:
        """Returns the row and column ranges of cells whose centre is within `margin` of a box (square distance)."""
        rows, columns = self._free.shape
        west = min(max(1, ceil((box[0] - margin - self._x0) / _CELL_M + 0.5)), columns - 1)
        east = min(max(1, ceil((box[2] + margin - self._x0) / _CELL_M + 0.5)), columns - 1)
        south = min(max(1, ceil((box[1] - margin - self._y0) / _CELL_M + 0.5)), rows - 1)
        north = min(max(1, ceil((box[3] + margin - self._y0) / _CELL_M + 0.5)), rows - 1)
        return slice(south, north), slice(west, east)
