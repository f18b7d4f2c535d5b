"""Forms that pictures alone show: round cushions and crockery, panels of doors, weave of cloth, drawings in frames.

Worlds keep plain boxes and few triangles, which robots touch; their pictures show how such things are made.
"""

import re
from functools import lru_cache

import numpy as np
import trimesh

from ..ornaments.ornament_shapes import FORMS
from ..ornaments.ornaments import Floats, Ints, Mesh
from .outside import noise
from .ray_casting import Array

_MESH = re.compile(r'^ *<mesh name="(shape_([a-z]+)_(\d+)_(\d+)_(\d+))" .*/>$', re.MULTILINE)

_ROUNDED_M = {"bevel": 0.012, "padded": 0.035, "soft": 0.045}
"""Radius of the rounded edges of boxes; soft ones bulge as well."""
_BULGE = {"bevel": 0.0, "padded": 0.12, "soft": 0.09}
"""Height of the bulge, over the shortest side, up to `_MOST_BULGE_M`."""
_MOST_BULGE_M = 0.022
_CUSHION_M = 0.75
"""Longest side, in metres, of a soft box that bulges: longer ones, such as mattresses, would let neighbours through."""
_ARC, _FLAT = 6, 9
"""Number of rows of vertices of a rounded edge, and of what lies between two of them."""
_HARD = ("block", "shade", "curtain")
"""Forms that stay as they are, or whose edges are meant to be sharp."""
_TWICE = ("bush", "sprigs", "plate")
"""Forms of thin parts: they are divided once, as rounding makes them thinner."""

_PANELLED = re.compile(r"\.front-\d|\.door-(front|side)$|^cabinet_\w+_door_\d+$")
"""Pattern of the names of doors and drawers of cupboards."""
_CLOTH = re.compile(
    r"^(Sofas|LivingRoomChairs|Ottomans|Beds|StorageBenches|DeskChairs)_\d+\.(?!leg|foot|plinth|column|castor|frame|headboard|panel)"
    r"|^(Clothes_\d+|DiningChairs_\d+\.pad)|^(rug|curtain|blind)_\d*(?!.*_(rod|bar)$)"
)
"""Pattern of the names of what is covered with cloth."""
_LEAST_PANEL_M = 0.22
"""Least side of a door or drawer with a panel, in metres; smaller ones are plain."""
_FRAME_M, _SLOPE_M = 0.06, 0.011
"""Width of a door's frame up to the middle of the slope to its panel, and half the slope's width, in metres."""
_SLOPE_SHADE, _PANEL_SHADE = 0.78, 0.98
_GAP_M, _GAP_SHADE = 0.004, 0.45
"""Width of the dark gap around a door or drawer, and the share of light in it."""
_THREADS_PER_M, _FOLDS_PER_M = 210.0, 14.0
_WEAVE, _CREASE = 0.13, 0.09
"""Differences of brightness between threads of cloth, and between its places, as shares of the whole."""


def refined(text: str) -> str:
    """Returns MJCF text whose decorative meshes have many triangles, in the place and size of the ones it had.

    Args:
        text: A decorated world's MJCF.
    """
    return _MESH.sub(_line, text)


def _line(found: re.Match[str]) -> str:
    name, form = found[1], found[2]
    if form in _HARD or form not in FORMS:
        return found[0]
    return _mesh(form, (int(found[3]) / 1000, int(found[4]) / 1000, int(found[5]) / 1000)).line(name)


def _mesh(form: str, size: tuple[float, float, float]) -> Mesh:
    if form in _ROUNDED_M:
        return _rounded(form, np.array(size))
    points, faces = _divided(form)
    coarse = FORMS[form](size).vertices
    low, high = coarse.min(axis=0), coarse.max(axis=0)
    return Mesh((low + high) / 2 + points * (high - low), faces)


@lru_cache(maxsize=64)
def _divided(form: str) -> tuple[Floats, Ints]:
    """Divides the triangles of a form and rounds them; returns vertices and triangles.

    They are stretched to a cube of side 1 about the origin.
    """
    coarse = FORMS[form]((1.0, 1.0, 1.0))
    mesh = trimesh.Trimesh(coarse.vertices, coarse.triangles, process=True)
    vertices, faces = trimesh.remesh.subdivide_loop(mesh.vertices, mesh.faces, iterations=1 if form in _TWICE else 2)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return (vertices - (low + high) / 2) / (high - low), np.asarray(faces, np.int64)


def _rounded(form: str, size: Floats) -> Mesh:
    """Makes a box with round edges, whose faces bulge if it is soft."""
    half = size / 2
    radius = min(_ROUNDED_M[form], *(0.98 * half))
    bulge = min(_BULGE[form] * float(size.min()), _MOST_BULGE_M) if size.max() < _CUSHION_M else 0.0
    points, faces = _grid_cube()
    signs = np.sign(points)
    # Rows are even steps along an edge's arc, up to 1; the flat part lies between -0.5 and 0.5.
    arc = np.clip((np.abs(points) - 0.5) * 2, 0, 1)
    flat = np.clip(np.abs(points) * 2, 0, 1)
    out = np.where(np.abs(points) == 1.0, 1.0, np.tan(arc * (np.pi / 4)))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    inner = half - radius
    places = signs * (flat * inner + radius * out)
    if bulge:
        # A face rises towards its middle, and the box is as large as before in all.
        over = np.argmax(np.abs(points), axis=1)
        rise = np.ones(len(points))
        for axis in range(3):
            across = np.abs(places[:, axis]) / half[axis]
            rise = rise * np.where(over == axis, 1.0, np.clip(1 - across**2, 0, 1))
        rows = np.arange(len(points))
        places[rows, over] += signs[rows, over] * bulge * (rise - 1) * np.where(arc[rows, over] >= 1, 1.0, 0.0)
    return Mesh(places, faces)


@lru_cache(maxsize=1)
def _grid_cube() -> tuple[Floats, Ints]:
    """Makes a cube from -1 to 1 with rows of vertices that are close together near its edges; edges are shared.

    Returns vertices (n, 3) and triangles.
    """
    arc = np.linspace(0.5, 1.0, _ARC)
    row = np.concatenate([-arc[::-1], np.linspace(-0.5, 0.5, _FLAT)[1:-1], arc])
    count = len(row)
    u, v = (axis.ravel() for axis in np.meshgrid(row, row, indexing="ij"))
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    quads = np.stack([first, first + count, first + count + 1, first + 1], axis=1)
    points: list[Floats] = []
    faces: list[Ints] = []
    for axis in range(3):
        for side in (1.0, -1.0):
            place = np.zeros((count * count, 3))
            place[:, axis], place[:, (axis + 1) % 3], place[:, (axis + 2) % 3] = side, u, v
            corners = (quads if side > 0 else quads[:, ::-1]) + len(points) * count * count
            points.append(place)
            faces += [corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]
    every, index = np.unique(np.round(np.concatenate(points), 6), axis=0, return_inverse=True)
    return every, index.reshape(-1)[np.concatenate(faces)]


def is_panelled(name: str, half: Array) -> bool:
    """Returns whether a box of half extents `half`, in metres, is a door or drawer with a panel."""
    return bool(_PANELLED.search(name.removesuffix("_seen"))) and float(np.sort(half)[1]) * 2 > _LEAST_PANEL_M


def is_cloth(name: str) -> bool:
    """Returns whether a geom of this name is covered with cloth."""
    return bool(_CLOTH.search(name.removesuffix("_seen")))


def panel(inside: Array, half: Array) -> tuple[Array, Array]:
    """Finds the slopes between frames and panels of doors, and the gaps around these.

    Args:
        inside: Places on boxes, in metres from their middles, shape (n, 3).
        half: Half extents of the boxes, shape (n, 3).

    Returns:
        Where the surface turns on the slopes, shape (n, 3), and the share of light on slopes and in gaps, shape (n,).
    """
    rows = np.arange(len(inside))
    thick = np.argmin(half, axis=1)
    from_edge = half - np.abs(inside)
    from_edge[rows, thick] = np.inf
    nearest = np.argmin(from_edge, axis=1)
    away = from_edge[rows, nearest]
    on_face = np.abs(inside[rows, thick]) > 0.9 * half[rows, thick]
    # It begins and ends softly: else it is as jagged as pixels are large.
    slope = on_face * np.clip(1 - np.abs(away - _FRAME_M) / _SLOPE_M, 0, 1)
    turned = np.zeros_like(inside)
    turned[rows, nearest] = -np.sign(inside[rows, nearest]) * slope
    deep = on_face & (away > _FRAME_M)
    gap = on_face * np.clip(1.5 - away / _GAP_M, 0, 1)
    share = 1 - (1 - _SLOPE_SHADE) * slope - (1 - _PANEL_SHADE) * deep
    return turned, share * (1 - (1 - _GAP_SHADE) * gap)


def weave(places: Array) -> Array:
    """Returns the brightness of cloth at places, shape (n,): threads, and places where it lies otherwise."""
    x, y, z = places.T
    right, up = x + 0.37 * z, y - 0.61 * z
    threads = 0.5 * noise(right * _THREADS_PER_M, up * 40) + 0.5 * noise(right * 40, up * _THREADS_PER_M)
    folds = noise(right * _FOLDS_PER_M, up * _FOLDS_PER_M)
    return 1 + _WEAVE * (threads - 0.5) + _CREASE * (folds - 0.5)


def drawn(colors: Array, inside: Array, half: Array, seeds: Array) -> Array:
    """Returns the colours of prints in frames: hills in the print's own colours.

    Args:
        colors: The plain colours, shape (n, 3).
        inside: Places on the prints, in metres from their middles, shape (n, 3).
        half: Half extents, shape (n, 3).
        seeds: A number for each print, shape (n,).
    """
    rows = np.arange(len(inside))
    # Walls run along one axis: the print's width is the longer of the two level ones.
    wide = np.argmax(half[:, :2], axis=1)
    along = inside[rows, wide] / np.maximum(half[rows, wide], 1e-6)
    up = inside[:, 2] / np.maximum(half[:, 2], 1e-6)
    shade = np.ones(len(rows))
    for layer in range(3):
        ridge = 0.75 - 0.62 * layer + 0.5 * (noise(along * (1.3 + layer) + 7.7 * seeds, seeds + 3.1 * layer) - 0.5)
        shade = np.where(up < ridge, 0.93 - 0.13 * layer, shade)
    return colors * shade[:, None]
