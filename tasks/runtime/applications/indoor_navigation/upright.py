"""Distances to upright things, for all rays of a lidar at once.

Walls and furniture are upright boxes and columns that a lidar's plane cuts right through. Where rays meet them is a
question of the floor plan, which a few array operations answer for a whole fan in the time that MuJoCo needs for some
rays, and equally exactly.

Places are complex numbers, metres. Of a ray we compute the inverse of its length, 0 where it meets nothing: along a
straight face it is a linear function of the ray's direction, and the largest one is the ray that ends first.
"""

import cmath
import math
from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Places = NDArray[np.complex128]
AnyPlace = TypeVar("AnyPlace", complex, NDArray[np.complex128])

_BESIDE_M = 1e-4
"""Things nearer to each other than this touch."""

_ROUNDING = 1e-9
"""Share of the angle between two rays by which everything is wider, so that no ray slips through between two faces."""


class Fan:
    """Rays at even angles all around."""

    def __init__(self, count: int, first_rad: float) -> None:
        """Prepares the directions.

        Args:
            count: rays all around.
            first_rad: angle of the first one; the others follow counter-clockwise.
        """
        self.count = count
        self._per_rad = count / math.tau
        # Angles from -pi on, as numbers of rays, lie from 0 to twice around.
        self._zero = (-first_rad * self._per_rad - count / 2) % count + count / 2
        # Three times around: what goes on over the last ray need not be cut there.
        self._around = np.exp(1j * (first_rad + np.arange(3 * count) / self._per_rad))
        self.directions: Places = self._around[:count]
        """Unit vectors of the rays."""
        self._numbers = np.arange(8 * count)

    def between(self, begins: Places, widths: Places) -> tuple[NDArray[np.intp], NDArray[np.intp], Places]:
        """Says which rays go through sectors.

        Args:
            begins: what lies in the directions where sectors begin.
            widths: what would lie where they end if they began at angle 0; they reach at most half around.

        Returns:
            How many rays go through each sector; and sector after sector the numbers of these rays, counting on after
            the last ray, and their directions.
        """
        per_rad = self._per_rad
        begin = np.arctan2(begins.imag, begins.real)
        begin *= per_rad
        begin += self._zero + (1.0 - _ROUNDING)
        width = np.arctan2(widths.imag, widths.real)
        width *= per_rad
        width += begin
        width += 2 * _ROUNDING
        firsts = begin.astype(np.intp)
        counts = width.astype(np.intp)
        counts -= firsts
        stops = counts.cumsum()
        total = int(stops[-1]) if stops.size else 0
        if total > len(self._numbers):
            self._numbers = np.arange(2 * total)
        firsts -= stops
        firsts += counts
        rays = firsts.repeat(counts)
        rays += self._numbers[:total]
        return counts, rays, self._around.take(rays)

    def largest(self, rays: NDArray[np.intp], values: Floats, least: float) -> Floats:
        """The largest of the values of each ray, and of `least`."""
        best = np.full(len(self._around), least)
        np.maximum.at(best, rays, values)
        return best.reshape(3, -1).max(axis=0)

    def to_disc(self, center: complex, radius_m: float, distances: Floats) -> Iterator[slice]:
        """Gives the rays that meet a disc, unless all of them have ended before it.

        Args:
            center: of the disc, in the fan's frame.
            radius_m: of the disc.
            distances: where the rays have ended so far.
        """
        away_m = abs(center)
        middle, half = cmath.phase(center) * self._per_rad + self._zero, self.count / 2
        if away_m > radius_m:
            half = math.asin(radius_m / away_m) * self._per_rad
        return self._parts(middle - half, middle + half, away_m - radius_m, distances)

    def to_corners(self, corners: Sequence[complex], least_m: float, distances: Floats) -> Iterator[slice]:
        """Gives the rays that meet a convex polygon, unless all of them have ended before it.

        Args:
            corners: of the polygon, in order, in the fan's frame.
            least_m: how far away all of it is at least.
            distances: where the rays have ended so far.
        """
        center = sum(corners) / len(corners)
        middle = cmath.phase(center) * self._per_rad + self._zero
        # Seen from outside, no side is seen from within.
        turns = [(one.conjugate() * other).imag for one, other in zip(corners, (*corners[1:], corners[0]), strict=True)]
        if min(turns) > -_BESIDE_M or max(turns) < _BESIDE_M:
            return self._parts(middle - self.count / 2, middle + self.count / 2, least_m, distances)
        sides = [cmath.phase(corner * center.conjugate()) * self._per_rad for corner in corners]
        return self._parts(middle + min(sides) - _ROUNDING, middle + max(sides) + _ROUNDING, least_m, distances)

    def _parts(self, begin: float, end: float, least_m: float, distances: Floats) -> Iterator[slice]:
        """The rays between two numbers, in one piece or two, as far as they have not ended before."""
        first = math.ceil(begin) % self.count
        stop = min(first + math.floor(end) - math.ceil(begin) + 1, first + self.count)
        for part in (slice(first, min(stop, self.count)), slice(0, max(stop - self.count, 0))):
            if part.stop > part.start and distances[part].max() > least_m:
                yield part


class Frame:
    """A robot's own frame in the plan: where it is, and which way its x and y axes point."""

    def __init__(self, origin: complex, x_axis: complex, y_axis: complex) -> None:
        """Prepares the change of frames.

        Args:
            origin: where it is.
            x_axis: its x axis seen from above, shorter than 1 when the robot is tilted.
            y_axis: its y axis likewise.
        """
        self.origin = origin
        doubled = 2 * (x_axis.conjugate() * y_axis).imag
        self._turn = (x_axis.conjugate() + 1j * y_axis.conjugate()) / doubled
        self._mirror = -(x_axis + 1j * y_axis) / doubled

    def enter(self, away: AnyPlace) -> AnyPlace:
        """Returns the place of something upright in the frame's own plane.

        Args:
            away: where it stands, seen from the origin in the world's directions.
        """
        return self._turn * away + self._mirror * away.conjugate()


class Faces:
    """The sides of upright boxes."""

    def __init__(self, boxes: Places, range_max_m: float) -> None:
        """Keeps the sides that can be seen.

        Args:
            boxes: their corners from above, shape (n, 4), clockwise.
            range_max_m: faces that are farther away are left out.
        """
        starts, ends = boxes.ravel(), np.roll(boxes, -1, axis=1).ravel()
        lengths = np.abs(ends - starts)
        normals = 1j * (ends - starts) / lengths
        seen = ~covered_sides(boxes, boxes).ravel()
        self._ends = np.stack((starts, ends))[:, seen]
        self._normals = np.stack((normals.real, normals.imag), axis=1)[seen]
        self._offsets = (normals.conj() * starts).real[seen]
        self._middles = self._ends.mean(axis=0)
        self._reaches = lengths[seen] / 2 + range_max_m

    def nearness(self, frame: Frame, fan: Fan) -> tuple[NDArray[np.intp], Floats]:
        """Rays of a fan in a frame that meet faces, and the inverse of their lengths in 1/m."""
        x, y = frame.origin.real, frame.origin.imag
        in_front = self._normals @ (x, y) > self._offsets
        in_range = np.abs(self._middles - frame.origin) < self._reaches
        chosen = np.flatnonzero(in_front & in_range)
        starts, ends = frame.enter(self._ends.take(chosen, axis=1) - frame.origin)
        products = starts.conj()
        products *= ends
        counts, rays, directions = fan.between(starts, products)
        slopes = (starts - ends) / products.imag
        # The real part of 1j * slope.conj() * direction.
        directions *= slopes.conj().repeat(counts)
        return rays, directions.imag


class Columns:
    """Upright round columns."""

    def __init__(self, centers: Places, radii_m: Floats, range_max_m: float) -> None:
        """Notes them.

        Args:
            centers: of their circles from above.
            radii_m: of their circles.
            range_max_m: columns that are farther away are left out.
        """
        rows = zip(centers.tolist(), radii_m.tolist(), strict=True)
        self._circles = [(center.real, center.imag, radius_m, radius_m + range_max_m) for center, radius_m in rows]

    def shorten(self, distances: Floats, frame: Frame, fan: Fan) -> None:
        """Ends the rays of a fan in a frame, which have got so far, at the columns."""
        x, y = frame.origin.real, frame.origin.imag
        for center_x, center_y, radius_m, reach_m in self._circles:
            if math.hypot(center_x - x, center_y - y) < reach_m:
                center = frame.enter(complex(center_x - x, center_y - y))
                for part in fan.to_disc(center, radius_m, distances):
                    # In each ray's own frame the middle lies so far ahead and so far aside.
                    middles = center * fan.directions[part].conj()
                    half_m = np.sqrt(np.maximum(radius_m**2 - middles.imag**2, 0.0))
                    np.minimum(distances[part], middles.real - half_m, out=distances[part])


def covered_sides(boxes: Places, others: Places) -> NDArray[np.bool_]:
    """Returns a mask of the sides of boxes that one of other boxes covers over their whole length.

    Args:
        boxes: their corners from above, shape (n, 4), clockwise.
        others: likewise.

    Returns:
        Shape (n, 4); the first side goes from the first corner to the second.
    """
    next_ = np.roll(boxes, -1, axis=1)
    outwards = 1j * (next_ - boxes) / np.abs(next_ - boxes)
    before = np.stack((boxes, next_), axis=2) + 2 * _BESIDE_M * outwards[:, :, np.newaxis]
    middles = others.mean(axis=1)
    covered = np.ones((*before.shape, len(others)), dtype=np.bool_)
    for side in (others[:, 1] - others[:, 0], others[:, 2] - others[:, 1]):
        half_m = np.abs(side) / 2
        along = ((before[..., np.newaxis] - middles) * (side / (2 * half_m)).conj()).real
        covered &= np.abs(along) <= half_m + _BESIDE_M
    return covered.all(axis=2).any(axis=2)
