"""Procedural meshes that fill a box: bevelled, turned, stuffed and leafy shapes.

They are closed, and have a few hundred triangles each.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, wraps
from math import cos, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.parts import Color, Part, Vector
from .ornaments import Floats, Ints, Mesh, Ornament, color_look, joined

Shape = Callable[[Vector], Mesh]
"""Function that makes a decorative mesh of a given size (box extents), centred at the origin."""

_SECTIONS = 14
_FOLDS = 5
_CLOTH_M = 0.004
_GOLDEN = 2.399963
"""Golden angle between two leaves of a stem, in radians."""

Unit = tuple[Floats, Ints]
"""Vertices and triangles of a form before it is stretched to a size."""


def _frozen(*arrays: NDArray[Any]) -> None:
    """Makes arrays that several meshes share read-only."""
    for array in arrays:
        array.flags.writeable = False


def filling(make: Callable[[], Unit]) -> Shape:
    """Makes a shape of a form that is stretched so that it fills a box about the origin; the form is made once."""

    @lru_cache(maxsize=1)
    def unit() -> Unit:
        points, triangles = make()
        low, high = points.min(axis=0), points.max(axis=0)
        points = (points - (low + high) / 2) / (high - low)
        _frozen(points, triangles)
        return points, triangles

    @wraps(make)
    def shape(size: Vector) -> Mesh:
        points, triangles = unit()
        return Mesh(points * np.array(size), triangles)

    return shape


def bevelled(size: Vector, radius: float) -> Mesh:
    """Makes the mesh of a box with rounded edges."""
    half = np.array(size) / 2
    radius = min(radius, *(0.98 * half))
    signs, out, triangles = _rounded()
    return Mesh(signs * (half - radius) + radius * out, triangles)


@lru_cache(maxsize=1)
def _rounded() -> tuple[Floats, Floats, Ints]:
    """Returns for each vertex of a rounded box its octant and its bulge direction, and the triangles."""
    # The second and third of four rows are where the rounding begins.
    points, triangles = _cube(np.array([-1.0, -0.5, 0.5, 1.0]))
    signs = np.sign(points)
    out = np.where(np.abs(points) == 1.0, signs, 0.0)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    _frozen(signs, out, triangles)
    return signs, out, triangles


def block(size: Vector) -> Mesh:
    """Makes the mesh of a box with sharp edges."""
    corners, triangles = _sharp()
    return Mesh(corners * (np.array(size) / 2), triangles)


@lru_cache(maxsize=1)
def _sharp() -> Unit:
    """Makes a box from -1 to 1 whose faces share no vertices."""
    points, triangles = _cube(np.array([-1.0, 1.0]))
    corners, numbered = points[triangles.ravel()], np.arange(triangles.size).reshape(-1, 3)
    _frozen(corners, numbered)
    return corners, numbered


def stuffed(size: Vector) -> Mesh:
    """Makes the mesh of a cushion."""
    points, triangles = _cushion(int(np.argmin(size)))
    return Mesh(points * (np.array(size) / 2), triangles)


@lru_cache(maxsize=3)
def _cushion(through: int) -> Unit:
    """Makes a cushion from -1 to 1 that is flat along one axis."""
    across = [axis for axis in range(3) if axis != through]
    count = 9
    row = np.sin(np.linspace(-pi / 2, pi / 2, count))
    u, v = (axis.ravel() for axis in np.meshgrid(row, row))
    rise = (np.clip(1 - u**4, 0, 1) * np.clip(1 - v**4, 0, 1)) ** 0.45
    # Sides between the corners are drawn in.
    pulled = 1 - 0.07 * (1 - np.minimum(np.abs(u), np.abs(v)) ** 2) * np.maximum(np.abs(u), np.abs(v)) ** 6
    layers = []
    for side in (1.0, -1.0):
        points = np.zeros((count * count, 3))
        points[:, across[0]], points[:, across[1]] = u * pulled, v * pulled
        points[:, through] = side * (0.04 + 0.96 * rise)
        layers.append(points)
    first = (np.arange(count - 1) + count * np.arange(count - 1)[:, None]).ravel()
    top = np.concatenate(
        [np.stack([first, first + 1, first + count + 1], 1), np.stack([first, first + count + 1, first + count], 1)]
    )
    if through == 1:
        top = top[:, ::-1]  # x and z are a left-handed pair about y
    bottom = top[:, ::-1] + count * count
    last = count * count - 1
    sides = np.arange(count), np.arange(2 * count - 1, last, count), np.arange(last, last - count, -1)
    rim = np.concatenate([*sides, np.arange(last + 1 - 2 * count, 0, -count)])
    after = np.roll(rim, -1)
    below = count * count
    seam = np.concatenate([np.stack([rim, below + rim, below + after], 1), np.stack([rim, below + after, after], 1)])
    if through == 1:
        seam = seam[:, ::-1]
    points, triangles = np.concatenate(layers), np.concatenate([top, bottom, seam])
    _frozen(points, triangles)
    return points, triangles


def lathed(profile: Sequence[tuple[float, float]]) -> Shape:
    """Makes a shape function for a surface of revolution about z, from radii and heights, 0 to 1."""
    return filling(lambda: _turned(profile))


def mug(size: Vector) -> Mesh:
    """Makes the mesh of a mug with its handle towards +y."""
    points, triangles = _mug()
    return Mesh(points * (size[0] / 2, size[1] / 2, size[2]), triangles)


@lru_cache(maxsize=1)
def _mug() -> Unit:
    """Makes a mug of radius 1 and height 1, centred at the origin."""
    body = _turned(((0.86, 0.0), (1.0, 0.1), (1.0, 1.0), (0.9, 1.0), (0.88, 0.12)))
    # The ear stands out of the box, as a cylinder of the cup's size is what collides.
    ear = _tube([(0.0, 1.0 + 0.62 * sin(a), 0.5 - 0.3 * cos(a)) for a in np.linspace(0.1, pi - 0.1, 6)], 0.1)
    points, triangles = joined([body, ear])
    points = points - (0, 0, 0.5)
    _frozen(points, triangles)
    return points, triangles


@filling
def bush() -> Unit:
    """Makes the mesh of a plant with broad leaves, of no particular size."""
    leaves = []
    for index in range(30):
        share = (index + 0.5) / 30
        turn, lean = index * _GOLDEN, 1.5 * (1 - share) ** 0.8
        root = (0.12 * cos(turn), 0.12 * sin(turn), 0.5 * share)
        leaves.append(_leaf(root, turn, lean, 0.62 + 0.2 * (index % 3), 0.24))
    return joined(leaves)


@filling
def sprigs() -> Unit:
    """Makes the mesh of a plant with long narrow leaves."""
    leaves = [
        _leaf((0.0, 0.0, 0.0), index * _GOLDEN, 0.15 + 0.9 * (index / 22), 1.0 - 0.2 * (index % 4) / 4, 0.07)
        for index in range(22)
    ]
    return joined(leaves)


@filling
def flowers() -> Unit:
    """Makes the mesh of flowers."""
    heads = []
    for index in range(7):
        turn, out = index * _GOLDEN, 0.75 * (index / 6) ** 0.6
        points, triangles = _turned(((0.5, 0.0), (1.0, 0.55), (0.7, 0.8), (0.25, 0.6)), sections=5)
        center = (out * cos(turn), out * sin(turn), 1.0 - 0.5 * out + 0.1 * (index % 2))
        heads.append((points * 0.24 + center, triangles))
    return joined(heads)


@filling
def crumpled() -> Unit:
    """Makes the mesh of crumpled cloth."""
    sections, rings = 16, 5
    angles = np.arange(sections) * (2 * pi / sections)
    outline = 1 + 0.16 * np.sin(3 * angles + 1) + 0.1 * np.sin(7 * angles)
    profile = [(0.9, 0.0), *((1 - ring / rings, 0.35 + 0.13 * ring) for ring in range(rings))]
    points, triangles = _turned(profile, sections)
    for ring in range(len(profile)):
        span = slice(ring * sections, (ring + 1) * sections)
        points[span, :2] *= outline[:, None]
        points[span, 2] *= 1 + 0.35 * np.sin(5 * angles + 2 * ring) * (ring < len(profile) - 1)
    return (points, triangles)


@filling
def fruit() -> Unit:
    """Makes the mesh of a heap of fruit."""
    spots = [(0.42 * cos(a), 0.42 * sin(a), 0.0) for a in np.arange(5) * (2 * pi / 5)] + [(0.0, 0.0, 0.45)]
    ball = _turned([(sin(a), 1 - cos(a)) for a in np.linspace(0.5, pi - 0.5, 3)], sections=7)
    return joined([(ball[0] * 0.34 + np.array(spot), ball[1]) for spot in spots])


@filling
def kettle() -> Unit:
    """Makes the mesh of a kettle with its spout towards +x."""
    body = _turned(((0.7, 0.0), (0.75, 0.1), (0.62, 0.6), (0.4, 0.74), (0.1, 0.8)))
    spout = _tube([(0.5, 0.0, 0.3), (0.85, 0.0, 0.5), (1.0, 0.0, 0.68)], 0.1)
    bow = _tube([(-0.6 * cos(a), 0.0, 0.55 + 0.45 * sin(a)) for a in np.linspace(0.0, 0.8 * pi, 6)], 0.06)
    return joined([body, spout, bow])


@filling
def pan() -> Unit:
    """Makes the mesh of a pan with its handle towards +x."""
    body = _turned(((0.8, 0.0), (1.0, 1.0), (0.95, 1.0), (0.76, 0.12)))
    handle = _tube([(0.95, 0.0, 0.8), (2.3, 0.0, 1.1)], 0.13)
    points, triangles = joined([body, handle])
    return (points, triangles)


def curtain(size: Vector) -> Mesh:
    """Makes the mesh of a curtain in waves along x."""
    wide, deep, tall = size
    count = _FOLDS * 5 + 1
    share = np.arange(count) / (count - 1)
    wave = np.sin(share * (2 * np.pi * _FOLDS))
    wave *= (deep - _CLOTH_M) / 2 / wave.max()
    rows = [
        np.stack([(share - 0.5) * wide, wave * gathered + side * _CLOTH_M / 2, np.full(count, height * tall)], axis=1)
        for height, gathered in ((-0.5, 1.0), (0.0, 0.9), (0.5, 0.6))
        for side in (1.0, -1.0)
    ]
    # Rows come in pairs: the side towards +y, then the side towards -y.
    bands = [(0, 2, False), (1, 3, True), (2, 4, False), (3, 5, True), (0, 1, True), (4, 5, False)]
    triangles = [_band(low * count, high * count, count, facing) for low, high, facing in bands]
    for side in (_side(low * count, count) for low in (0, 2)):
        triangles += [side, side[:, ::-1] + count - 1]
    return Mesh(np.concatenate(rows), np.concatenate(triangles))


def _band(first: int, second: int, count: int, facing: bool) -> Ints:
    """Returns triangles between two rows of vertices.

    Seen from -y with the second row above the first, they face the viewer or not, as `facing` says.
    """
    a = first + np.arange(count - 1)
    b = second + np.arange(count - 1)
    faces_eye = np.concatenate([np.stack([a, a + 1, b + 1], axis=1), np.stack([a, b + 1, b], axis=1)])
    return faces_eye if facing else faces_eye[:, ::-1]


def _side(first: int, count: int) -> Ints:
    """Returns two triangles that close one side between four rows of vertices, seen from -x."""
    a, b, c, d = first + count * np.array([0, 1, 3, 2])
    return np.array([[a, b, c], [a, c, d]])


@filling
def draped() -> Unit:
    """Makes the mesh of a towel over a rail along y."""
    count = 17
    y = np.linspace(-0.5, 0.5, count)
    wave = 0.18 * np.sin(y * 2 * pi * 3)
    rows = [
        np.stack([side * (0.5 - 0.32 * (height == 0.5)) + wave * (height < 0.3), y, np.full(count, height)], axis=1)
        for side, height in ((1, -0.5), (1, 0.3), (1, 0.5), (-1, 0.5), (-1, 0.3), (-1, -0.36))
    ]
    faces = []
    here = np.arange(count - 1)
    for row in range(len(rows)):
        a, b = row * count + here, (row + 1) % len(rows) * count + here
        faces += [np.stack([a, a + 1, b + 1], 1), np.stack([a, b + 1, b], 1)]
    ends = np.arange(len(rows)) * count
    fan = np.stack([np.full(4, ends[0]), ends[1:5], ends[2:6]], 1)
    return (np.concatenate(rows), np.concatenate([*faces, fan, fan[:, ::-1] + count - 1]))


def _cube(row: Floats) -> tuple[Floats, Ints]:
    """Makes a grid on each face of a cube from -1 to 1; corners and edges are shared.

    `row` has the places of the grid's lines, from -1 to 1. Returns points (n, 3) and triangles.
    """
    places: dict[tuple[float, ...], int] = {}
    triangles = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        for side in (1.0, -1.0):
            for i in range(len(row) - 1):
                for j in range(len(row) - 1):
                    corners = []
                    for u, v in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)):
                        point = [0.0, 0.0, 0.0]
                        point[axis], point[one], point[two] = side, float(row[u]), float(row[v])
                        corners.append(places.setdefault(tuple(point), len(places)))
                    a, b, c, d = corners if side > 0 else corners[::-1]
                    triangles += [(a, b, c), (a, c, d)]
    return np.array(list(places)), np.array(triangles)


def _turned(profile: Sequence[tuple[float, float]], sections: int = _SECTIONS) -> tuple[Floats, Ints]:
    """Makes a surface of revolution from a profile, closed at both ends.

    The profile has radii and heights, from the bottom up. Returns points (n, 3) and triangles.
    """
    angles = np.arange(sections) * (2 * pi / sections)
    rings = [np.stack([r * np.cos(angles), r * np.sin(angles), np.full(sections, z)], 1) for r, z in profile]
    points = [*rings, np.array([[0.0, 0.0, profile[0][1]], [0.0, 0.0, profile[-1][1]]])]
    here, after = np.arange(sections), (np.arange(sections) + 1) % sections
    low, high = len(profile) * sections, len(profile) * sections + 1
    faces = [np.stack([np.full(sections, low), after, here], 1)]
    for ring in range(len(profile) - 1):
        a, b = here + ring * sections, after + ring * sections
        faces += [np.stack([a, b, b + sections], 1), np.stack([a, b + sections, a + sections], 1)]
    last = (len(profile) - 1) * sections
    faces.append(np.stack([np.full(sections, high), here + last, after + last], 1))
    return np.concatenate(points), np.concatenate(faces)


def _tube(path: Sequence[Vector], radius: float, sides: int = 6) -> tuple[Floats, Ints]:
    """Makes a bent rod along a path, closed at both ends.

    The path must lie in a plane along two axes. Returns points (n, 3) and triangles.
    """
    line = np.array(path)
    ahead = np.gradient(line, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    # Paths lie in a plane: what is across all of it is one side, the other turns with the path.
    flat = np.argmin(np.abs(ahead).max(axis=0))
    one = np.zeros(3)
    one[flat] = 1.0
    two = np.cross(ahead, one)
    angles = np.arange(sides) * (2 * pi / sides)
    rings = [
        center + radius * (np.outer(np.cos(angles), one) + np.outer(np.sin(angles), side))
        for center, side in zip(line, two, strict=True)
    ]
    here, after = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = []
    for ring in range(len(rings) - 1):
        a, b = here + ring * sides, after + ring * sides
        faces += [np.stack([a, b + sides, b], 1), np.stack([a, a + sides, b + sides], 1)]
    fan = np.stack([np.zeros(sides - 2, np.int64), np.arange(1, sides - 1), np.arange(2, sides)], 1)
    return np.concatenate(rings), np.concatenate([*faces, fan, fan[:, ::-1] + (len(rings) - 1) * sides])


def _leaf(root: Vector, turn: float, lean: float, length: float, wide: float) -> tuple[Floats, Ints]:
    """Makes a closed, thin leaf that grows from its root, leans outwards and hangs a little at its end.

    `turn` is the direction about z, and `lean` the angle from upright, both in radians. Returns points and triangles.
    """
    out, up, aside = sin(lean), cos(lean), np.array([-sin(turn), cos(turn), 0.0])
    away = np.array([cos(turn), sin(turn), 0.0])
    middle = np.array(root) + 0.55 * length * (out * away + np.array([0.0, 0.0, up]))
    tip = np.array(root) + length * ((out + 0.12) * away + np.array([0.0, 0.0, up - 0.18]))
    across = np.array([0.0, 0.0, out]) - up * away  # what looks up or inwards
    sides = middle + wide / 2 * aside, middle - wide / 2 * aside
    points = np.array([root, sides[0], tip, sides[1], middle - 0.018 * across, middle - 0.042 * across])
    upper = [(0, 3, 4), (3, 2, 4), (2, 1, 4), (1, 0, 4)]
    lower = [(b, a, 5) for a, b, _ in upper]
    return points, np.array(upper + lower)


_ROUNDING_M = 0.012

FORMS: dict[str, Shape] = {
    "block": block,
    "bevel": lambda size: bevelled(size, _ROUNDING_M),
    "padded": lambda size: bevelled(size, 0.35 * min(size)),
    "soft": lambda size: bevelled(size, 0.045),
    "cushion": stuffed,
    "crumpled": crumpled,
    "bush": bush,
    "sprigs": sprigs,
    "flowers": flowers,
    "fruit": fruit,
    "kettle": kettle,
    "pan": pan,
    "draped": draped,
    "curtain": curtain,
    "mug": mug,
    "pot": lathed(((0.7, 0.0), (0.92, 0.82), (1.0, 0.82), (1.0, 1.0), (0.86, 1.0), (0.84, 0.88))),
    "vase": lathed(((0.6, 0.0), (0.86, 0.14), (1.0, 0.38), (0.84, 0.66), (0.44, 0.86), (0.56, 1.0), (0.4, 0.98))),
    "bottle": lathed(((0.92, 0.0), (1.0, 0.04), (1.0, 0.58), (0.4, 0.76), (0.34, 0.97), (0.42, 1.0))),
    "jar": lathed(((0.9, 0.0), (1.0, 0.06), (1.0, 0.74), (0.86, 0.8), (0.94, 0.82), (0.94, 1.0))),
    "bowl": lathed(((0.42, 0.0), (0.5, 0.08), (0.86, 0.5), (1.0, 1.0), (0.94, 1.0), (0.8, 0.56), (0.4, 0.16))),
    "plate": lathed(((0.6, 0.0), (0.68, 0.3), (1.0, 1.0), (0.98, 1.0), (0.66, 0.5))),
    "shade": lathed(((0.96, 0.0), (1.0, 0.0), (0.66, 1.0), (0.62, 1.0))),
    "glass": lathed(((0.74, 0.0), (1.0, 1.0), (0.94, 1.0), (0.7, 0.08))),
    "lamp": lathed(((1.0, 0.0), (1.0, 0.1), (0.3, 0.2), (0.42, 0.5), (0.2, 0.9), (0.2, 1.0))),
    "ball": lathed([(sin(a), (1 - cos(a)) / 2) for a in (0.45, 0.9, 1.35, 1.8, 2.25, 2.7)]),
}
"""Procedural shapes by name."""

# By kinds of furniture: beginnings of the names of parts, the longest that fits counts.
_CLOTH = {"cushion": "soft", "back-cushion": "soft", "pillow": "cushion", "base": "soft", "back": "soft", "arm": "soft"}
_GREEN = {"plant": "bush", "bunch": "sprigs", "moss": "bush", "pot": "pot", "vase": "vase"}
_LAMP = {"lamp-shade": "shade", "lamp-foot": "pot", "shade": "shade"}
_SET = {"bowl": "bowl", "tray": "bowl", "fruit": "fruit", "bottle": "bottle", "cup": "glass", "glass": "glass"}
_EVERYWHERE = {**_GREEN, **_LAMP, **_SET, "top": "bevel", "teapot": "kettle", "seat": "bevel", "pad": "padded"}
_OF_KIND: dict[str, dict[str, str]] = {
    "Beds": {
        "mattress": "soft", "duvet": "soft", "fold": "soft", "throw": "soft", "pillow": "cushion",
        "cushion": "cushion", "headboard": "bevel", "frame": "bevel",
    },
    "Clothes": {"lower": "crumpled", "upper": "crumpled"},
    "Cup": {"cup": "mug"},
    "DeskChairs": {"cushion": "cushion", "back": "padded", "seat": "padded", "lumbar": "cushion"},
    "DiningChairs": {"back": "bevel"},
    "FloorLamps": {"foot": "pot"},
    "LivingRoomChairs": _CLOTH,
    "Ottomans": {"cushion": "padded", "body": "soft"},
    "Plate": {"plate": "plate"},
    "Sofas": _CLOTH,
    "StorageBenches": {"cushion": "padded"},
    "Toilets": {"bowl": "", "seat": ""},
    "VanityCounters": {"basin": "bowl", "bowl": ""},
}  # fmt: skip


_LEAFY = ("bush", "sprigs", "fruit", "cushion", "crumpled")
"""Shapes that replace ellipsoids."""
_TURNED = ("bottle", "bowl", "glass", "jar", "kettle", "mug", "plate", "pot", "shade", "vase")
"""Shapes of round objects."""


def form_of(kind: str, part: Part) -> str:
    """Returns the name in `FORMS` of the mesh that replaces a furniture part; empty if it stays as it is."""
    return _form(kind, part.name, part.shape)


@lru_cache(maxsize=2048)
def _form(kind: str, part: str, shape: str) -> str:
    names = {**_EVERYWHERE, **_OF_KIND.get(kind, {})}
    fits = [name for name in names if part == name or part.startswith(f"{name}-")]
    form = names[max(fits, key=len)] if fits else ""
    if shape == "ellipsoid":
        return form if form in _LEAFY else ""
    return form if (shape == "cylinder") == (form in _TURNED) else ""


class Shapes:
    """Collects the meshes of a world's model, each once."""

    def __init__(self) -> None:
        """Makes an empty collection of meshes."""
        self._lines: dict[str, str] = {}

    def named(self, form: str, size: Vector) -> str:
        """Returns the name of a mesh of this form and size, making it if necessary."""
        name = "_".join(["shape", form, *(str(round(1000 * extent)) for extent in size)])
        if name not in self._lines:
            self._lines[name] = _mesh_line(name, form, size)
        return name

    def drawn(self, name: str, form: str, size: Vector, center: Vector, color: Color, yaw: float) -> Ornament:
        """Makes a decorative geom of a mesh, at a position and turned about z."""
        return Ornament(name, "mesh", center, (), color_look(color), turned_quat(yaw), self.named(form, size))

    def lines(self) -> Iterator[str]:
        """Yields all collected meshes as MJCF assets."""
        return iter(self._lines.values())


@lru_cache(maxsize=1024)
def _mesh_line(name: str, form: str, size: Vector) -> str:
    """Formats a mesh as MJCF; results are cached, as most worlds of a template have the same shapes."""
    return FORMS[form](size).line(name)


def turned_quat(yaw: float) -> str:
    """Formats a rotation about z as an MJCF attribute; empty for no rotation."""
    return f"{cos(yaw / 2):.6f} 0 0 {sin(yaw / 2):.6f}" if yaw else ""
