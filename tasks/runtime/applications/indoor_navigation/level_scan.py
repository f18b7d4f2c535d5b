"""Fast 2D lidar for level robots: intersects rays with the outlines of walls and furniture instead of ray casting."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import cmath
import copy
import math
from collections.abc import Iterator, Sequence
from typing import TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Places = NDArray[np.complex128]
AnyPlace = TypeVar("AnyPlace", complex, NDArray[np.complex128])

_BESIDE_M = 1e-4
"""Distance in metres below which two surfaces touch."""

_ROUNDING = 1e-9
"""Fraction of the angle between two rays by which every sector is widened, so that no ray slips between two faces."""


class Fan:
    """Evenly spaced lidar rays over 360 degrees, in a horizontal plane."""

    def __init__(self, count: int, first_rad: float) -> None:
        """Computes the directions of evenly spaced lidar rays.

        Args:
            count: Number of rays over 360 degrees.
            first_rad: Angle of the first ray, in radians; the others follow counter-clockwise.
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
        """Finds the rays that pass through angular sectors.

        Args:
            begins: Points in the directions where the sectors begin, as complex numbers.
            widths: Points in the directions where the sectors would end if they began at angle 0; a sector is at most
                180 degrees wide.

        Returns:
            Number of rays through each sector; ray numbers, sector after sector, which continue to count after the last
            ray; and the directions of these rays.
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
        """Returns for each ray the maximum of its values, at least `least`."""
        best = np.full(len(self._around), least)
        np.maximum.at(best, rays, values)
        return best.reshape(3, -1).max(axis=0)

    def to_disc(self, center: complex, radius_m: float, distances: Floats) -> Iterator[slice]:
        """Yields slices of the rays that hit a disc before their present ends.

        Args:
            center: Centre of the disc in the fan's frame, as a complex number.
            radius_m: Radius of the disc.
            distances: Present lengths of the rays, in metres.
        """
        away_m = abs(center)
        middle, half = cmath.phase(center) * self._per_rad + self._zero, self.count / 2
        if away_m > radius_m:
            half = math.asin(radius_m / away_m) * self._per_rad
        return self._parts(middle - half, middle + half, away_m - radius_m, distances)

    def to_corners(self, corners: Sequence[complex], least_m: float, distances: Floats) -> Iterator[slice]:
        """Yields slices of the rays that hit a convex polygon before their present ends.

        Args:
            corners: Corners of the polygon in order, in the fan's frame, as complex numbers.
            least_m: Lower bound for the distance of the polygon.
            distances: Present lengths of the rays, in metres.
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
        """Yields one or two slices of the rays between two ray numbers, unless all of them end before `least_m`."""
        first = math.ceil(begin) % self.count
        stop = min(first + math.floor(end) - math.ceil(begin) + 1, first + self.count)
        for part in (slice(first, min(stop, self.count)), slice(0, max(stop - self.count, 0))):
            if part.stop > part.start and distances[part].max() > least_m:
                yield part


class Frame:
    """A robot's position and axes, projected to the floor plan, which convert positions in the world to its own."""

    def __init__(self, origin: complex, x_axis: complex, y_axis: complex) -> None:
        """Stores the robot's position and axes, for the conversion of positions.

        Args:
            origin: Position of the robot on the floor plan, as a complex number.
            x_axis: The robot's x axis seen from above; shorter than 1 if the robot is tilted.
            y_axis: The robot's y axis seen from above; shorter than 1 if the robot is tilted.
        """
        self.origin = origin
        doubled = 2 * (x_axis.conjugate() * y_axis).imag
        self._turn = (x_axis.conjugate() + 1j * y_axis.conjugate()) / doubled
        self._mirror = -(x_axis + 1j * y_axis) / doubled

    def enter(self, away: AnyPlace) -> AnyPlace:
        """Converts positions relative to the robot, along the world's axes (x + iy), to the robot's axes; in metres.

        Args:
            away: Positions relative to the robot, along the world's axes.
        """
        return self._turn * away + self._mirror * away.conjugate()


class Faces:
    """Vertical sides of box-shaped obstacles, of which the distances along a lidar's rays are computed."""

    def __init__(self, boxes: Places, range_max_m: float) -> None:
        """Selects the sides of box-shaped obstacles that a lidar's ray can hit.

        Args:
            boxes: Corners of the boxes from above, shape (n, 4), clockwise.
            range_max_m: Range of the lidar; farther sides are left out.
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
        """Computes which of a lidar's rays hit the sides of the outlines, and the inverse of their lengths in 1/m.

        A ray that hits several sides occurs several times.

        Args:
            frame: Position and heading of the lidar.
            fan: Its rays.

        Returns:
            Numbers of the rays, and as many inverse lengths.
        """
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
    """Vertical cylinders as obstacles, by which a lidar's rays are shortened."""

    def __init__(self, centers: Places, radii_m: Floats, range_max_m: float) -> None:
        """Stores the vertical cylinders that a lidar's rays may hit.

        Args:
            centers: Centres of the circles from above.
            radii_m: Radii of the circles.
            range_max_m: Range of the lidar; farther cylinders are left out.
        """
        rows = zip(centers.tolist(), radii_m.tolist(), strict=True)
        self._circles = [(center.real, center.imag, radius_m, radius_m + range_max_m) for center, radius_m in rows]

    def shorten(self, distances: Floats, frame: Frame, fan: Fan) -> None:
        """Shortens the rays of a lidar that hit the cylinders, in place.

        Args:
            distances: Lengths of the rays in metres, shape (rays,).
            frame: Position and heading of the lidar.
            fan: Its rays.
        """
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
    """Returns a mask of the box sides that are completely covered by another box, so that no ray can hit them.

    Args:
        boxes: Corners of the boxes from above, shape (n, 4), clockwise.
        others: Corners of the boxes that may cover them, in the same form.

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


_LEVEL = 0.01
"""Sine of the tilt up to which a lidar counts as level; the robot Scout on its slides stays under 0.008."""

_SWAY_M = 0.005
"""Largest change of a lidar's height in metres at which it still counts as level."""

_MARGIN_M = 0.002
"""Margin added to the bounding spheres of geoms for which MuJoCo casts rays, in metres."""

_NOTHING = 1e-9
"""Inverse length of a ray without a hit, 1/m."""

_SEEN, _UNSEEN = 0, 5
_SEEN_ONLY = np.array([1, 0, 0, 0, 0, 0], np.uint8)

_EXACT = 1 - 1e-9
"""Cosine of the angle up to which two directions count as parallel."""

_BOX, _CYLINDER, _PLANE = (
    int(kind) for kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_PLANE)
)


class LevelScan:
    """Fast lidar of a level robot: intersects rays with a floor plan instead of MuJoCo geoms.

    The sides of fixed, upright boxes and cylinders come from the plan of the world. All other geoms (movable, tilted,
    of other shapes, or ending within the lidar's plane) are left to MuJoCo's ray casting, for the rays that can hit
    them.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        body_id: int,
        height_m: float,
        fan: Fan,
        range_max_m: float,
        groups: NDArray[np.uint8],
    ) -> None:
        """Computes the floor plan of the model's fixed walls and furniture.

        Args:
            model: The compiled world with the robot.
            data: State of the model, after `mj_forward`; read at every measurement.
            body_id: The robot's root body, which rays start in and do not hit.
            height_m: Height of the lidar on the body's z axis; also its height over the floor when the body is level.
            fan: Rays of the lidar.
            range_max_m: Range of the lidar.
            groups: Mask of the geom groups that rays can hit.

        Raises:
            ValueError: A geom has a shape whose extent is unknown.
        """
        if model.nflex:
            raise ValueError("there are soft bodies")
        self._model, self._data, self._body_id = model, data, body_id
        self._rotation, self._position = data.xmat[body_id].reshape(3, 3), data.xpos[body_id]
        self._height_m, self._range_max_m, self._groups, self._fan = height_m, range_max_m, groups, fan
        self._rays = np.stack((fan.directions.real, fan.directions.imag, np.zeros(fan.count)), axis=1)
        self._geoms, self._ends = np.zeros(fan.count, np.int32), np.zeros(fan.count)
        self._asked = np.zeros(fan.count, np.bool_)
        self._tolerance_m = range_max_m * _LEVEL + _SWAY_M
        low, high = _vertical_extents(model, data)
        fixed = model.geom_bodyid == 0
        visible = groups[model.geom_group].astype(np.bool_) & (_alpha(model) > 0)
        crossed = (low <= height_m + self._tolerance_m) & (high >= height_m - self._tolerance_m)
        passed = (low <= height_m - self._tolerance_m) & (high >= height_m + self._tolerance_m)
        upright = _are_upright(model, data)
        plain = upright & fixed & passed & visible
        boxes = np.flatnonzero(plain & (model.geom_type == _BOX))
        cylinders = np.flatnonzero(plain & (model.geom_type == _CYLINDER))
        corners = _corners(model, data, boxes)
        self._faces = Faces(corners, range_max_m)
        self._columns = Columns(_places(data, cylinders), model.geom_size[cylinders, 0].copy(), range_max_m)
        others = visible & np.where(fixed, crossed, model.geom_bodyid != body_id)
        others[boxes] = others[cylinders] = False
        # What is boxed in, such as the water of a bath, is never seen.
        inner = np.flatnonzero(others & fixed & (model.geom_type == _BOX) & upright)
        others[inner[covered_sides(_corners(model, data, inner), corners).all(axis=1)]] = False
        self._ask_about(np.flatnonzero(others))

    def measure(self) -> Floats | None:
        """Measures the lidar's distances in metres, one for each ray, infinite without a hit within the range.

        Returns `None` if the robot is tilted or lifted, as then only MuJoCo's ray casting is right.
        """
        (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = self._rotation.tolist()
        x, y, z = self._position.tolist()
        h = self._height_m
        x, y, z = x + h * zx, y + h * zy, z + h * zz
        if math.hypot(xz, yz) > _LEVEL or abs(z - h) > _SWAY_M or zz < 0:
            return None
        frame, fan = Frame(complex(x, y), complex(xx, xy), complex(yx, yy)), self._fan
        distances = 1.0 / fan.largest(*self._faces.nearness(frame, fan), least=_NOTHING)
        self._columns.shorten(distances, frame, fan)
        self._add_others(distances, frame, z)
        distances[distances > self._range_max_m] = np.inf
        return distances

    def _ask_about(self, geoms: NDArray[np.intp]) -> None:
        """Stores bounding spheres of the geoms that are left to MuJoCo's ray casting: fixed geoms, moving bodies.

        Raises `ValueError` if one of them has no end, such as a plane.
        """
        model = self._model
        if (model.geom_rbound[geoms] <= 0).any():
            raise ValueError("there are geoms without an end")
        bodies = model.geom_bodyid[geoms]
        self._middles, radii_m = [], []
        for body in np.unique(bodies[bodies != 0]).tolist():
            own = geoms[bodies == body]
            largest = own[np.argmax(model.geom_rbound[own])]
            away_m = np.linalg.norm(model.geom_pos[own] - model.geom_pos[largest], axis=1)
            self._middles.append(int(largest))
            radii_m.append(float((away_m + model.geom_rbound[own]).max()))
        self._middles += geoms[bodies == 0].tolist()
        radii_m += model.geom_rbound[geoms[bodies == 0]].tolist()
        self._radii_m = [radius_m + _MARGIN_M for radius_m in radii_m]
        # Upright boxes that do not move are seen at smaller angles than the spheres around them.
        fixed = geoms[bodies == 0]
        boxes = (model.geom_type[fixed] == _BOX) & _are_upright(model, self._data)[fixed]
        outlines = iter(_corners(model, self._data, fixed[boxes]).tolist())
        self._outlines: list[list[complex]] = [[]] * (len(self._middles) - len(fixed))
        self._outlines += [next(outlines) if box else [] for box in boxes.tolist()]
        # A model in which rays meet nothing else; its order of geoms is the same, so that it can be used with the data.
        self._model = copy.copy(model)
        self._model.geom_group[:] = _UNSEEN
        self._model.geom_group[geoms[self._groups[model.geom_group[geoms]] > 0]] = _SEEN

    def _add_others(self, distances: Floats, frame: Frame, height_m: float) -> None:
        """Shortens the rays that hit geoms outside the floor plan, in place, with MuJoCo's ray casting.

        Args:
            distances: Lengths of the rays in metres, shape (rays,).
            frame: Position and heading of the lidar.
            height_m: Height of the lidar above the floor, in metres.
        """
        x, y = frame.origin.real, frame.origin.imag
        middles = self._data.geom_xpos.take(self._middles, axis=0).tolist()
        parts: list[slice] = []
        for (middle_x, middle_y, middle_z), radius_m, corners in zip(
            middles, self._radii_m, self._outlines, strict=True
        ):
            aside = complex(middle_x - x, middle_y - y)
            if abs(middle_z - height_m) < radius_m + self._tolerance_m and abs(aside) < radius_m + self._range_max_m:
                center = frame.enter(aside)
                if corners:
                    seen = [frame.enter(corner - frame.origin) for corner in corners]
                    parts += self._fan.to_corners(seen, abs(center) - radius_m, distances)
                else:
                    parts += self._fan.to_disc(center, radius_m, distances)
        if parts:
            # All at once: MuJoCo's preparations for a bundle of rays cost as much as many rays.
            self._asked[:] = False
            for part in parts:
                self._asked[part] = True
            self._ask(self._asked.nonzero()[0], distances, (x, y, height_m))

    def _ask(self, numbers: NDArray[np.intp], distances: Floats, origin: tuple[float, float, float]) -> None:
        count = len(numbers)
        ahead, aside = self._rotation[:, 0], self._rotation[:, 1]
        chosen = self._rays.take(numbers, axis=0)
        vectors = chosen[:, :1] * ahead + chosen[:, 1:2] * aside
        ends = self._ends[:count]
        mujoco.mj_multiRay(
            self._model, self._data, origin, vectors.ravel(), _SEEN_ONLY, True, self._body_id,
            self._geoms[:count], ends, None, count, self._range_max_m,
        )  # fmt: skip
        ends[ends < 0] = np.inf
        distances[numbers] = np.minimum(distances.take(numbers), ends)


def _vertical_extents(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Floats, Floats]:
    """Returns the lowest and highest z of each geom now, in metres; equal for horizontal planes."""
    vertical = data.geom_xmat[:, 6:9]
    plane = model.geom_type == _PLANE
    level = np.abs(vertical[:, 2]) > _EXACT
    middle = data.geom_xpos[:, 2] + np.where(plane, 0.0, np.einsum("ij,ij->i", vertical, model.geom_aabb[:, :3]))
    reach = np.einsum("ij,ij->i", np.abs(vertical), model.geom_aabb[:, 3:])
    reach[plane] = np.where(level[plane], 0.0, np.inf)
    return middle - reach, middle + reach


def _alpha(model: mujoco.MjModel) -> NDArray[np.float32]:
    """Returns the opacities (alpha) of the geoms; rays pass through fully transparent geoms."""
    own = model.geom_matid < 0
    alpha = model.geom_rgba[:, 3].copy()
    alpha[~own] = model.mat_rgba[model.geom_matid[~own], 3]
    return alpha


def _are_upright(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.bool_]:
    """Returns a mask of the geoms that are boxes with an upright edge, or cylinders with an upright axis."""
    vertical = np.abs(data.geom_xmat[:, 6:9])
    box = (model.geom_type == _BOX) & (vertical.max(axis=1) > _EXACT)
    return box | ((model.geom_type == _CYLINDER) & (vertical[:, 2] > _EXACT))


def _corners(model: mujoco.MjModel, data: mujoco.MjData, boxes: NDArray[np.intp]) -> NDArray[np.complex128]:
    """Returns the corners of upright boxes as seen from above, in metres (x + iy), clockwise, shape (n, 4)."""
    corners = np.zeros((len(boxes), 4), np.complex128)
    for row, (geom, middle) in enumerate(zip(boxes.tolist(), _places(data, boxes).tolist(), strict=True)):
        axes = data.geom_xmat[geom].reshape(3, 3)
        first, second = np.flatnonzero(np.abs(axes[2]) < 0.5).tolist()
        along, across = (
            complex(*axes[:2, axis].tolist()) * float(model.geom_size[geom, axis]) for axis in (first, second)
        )
        if (along.conjugate() * across).imag < 0:
            across = -across
        corners[row] = middle + np.array((along + across, along - across, -along - across, -along + across))
    return corners


def _places(data: mujoco.MjData, geoms: NDArray[np.intp]) -> NDArray[np.complex128]:
    return data.geom_xpos[geoms, 0] + 1j * data.geom_xpos[geoms, 1]
