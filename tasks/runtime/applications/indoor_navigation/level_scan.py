"""Lidar measurements of a level robot: from the world's plan where that is exact, by MuJoCo where it is not."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import copy
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from .upright import Columns, Faces, Fan, Floats, Frame, covered_sides

_LEVEL = 0.01
"""Sine of the tilt up to which a lidar counts as level; Scout on its slides stays under 0.008."""

_SWAY_M = 0.005
"""How far a level lidar may rise or sink."""

_MARGIN_M = 0.002
"""Margin added to the radii of the spheres around things that MuJoCo is asked about, in metres."""

_NOTHING = 1e-9
"""Inverse length of a ray that meets nothing, 1/m."""

_SEEN, _UNSEEN = 0, 5
_SEEN_ONLY = np.array([1, 0, 0, 0, 0, 0], np.uint8)

_EXACT = 1 - 1e-9
"""Cosine from which directions are the same."""

_BOX, _CYLINDER, _PLANE = (
    int(kind) for kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_PLANE)
)


class LevelScan:
    """Measures with rays all around a body's axis for as long as the body stands level.

    The sides of fixed, upright boxes and cylinders come from the plan of the world. Everything else (what can move,
    what lies or is otherwise shaped, what ends within the lidar's plane) is left to MuJoCo, which is asked only about
    the rays that go there.
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
        """Draws the plan.

        Args:
            model: the compiled world with the robot.
            data: its state, after `mj_forward`; read at every measurement.
            body_id: the robot's root body, which rays start in and do not hit.
            height_m: where on its axis they start; also how high that is over the floor when the body is level.
            fan: the rays.
            range_max_m: what lies farther away is not seen.
            groups: which geom groups rays can hit.

        Raises:
            ValueError: there is something of which it is not known where it ends.
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
        """Distances in metres, one per ray, infinite where nothing is in range; nothing when the body is not level."""
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
        """Notes spheres around what is left to MuJoCo: fixed geoms, and the bodies of others."""
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
        """Shortens the rays that end at what is left to MuJoCo."""
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
    """Between which heights geoms are now; horizontal planes have one."""
    vertical = data.geom_xmat[:, 6:9]
    plane = model.geom_type == _PLANE
    level = np.abs(vertical[:, 2]) > _EXACT
    middle = data.geom_xpos[:, 2] + np.where(plane, 0.0, np.einsum("ij,ij->i", vertical, model.geom_aabb[:, :3]))
    reach = np.einsum("ij,ij->i", np.abs(vertical), model.geom_aabb[:, 3:])
    reach[plane] = np.where(level[plane], 0.0, np.inf)
    return middle - reach, middle + reach


def _alpha(model: mujoco.MjModel) -> NDArray[np.float32]:
    """Opacities; rays go through what is wholly transparent."""
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
    """Corners of upright boxes from above, clockwise, shape (n, 4)."""
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
