"""Meshes of cushions, crockery and plants for pictures, with so many triangles that they look round."""

import re
from functools import lru_cache

import numpy as np
import trimesh

from ..ornaments.ornament_shapes import FORMS
from ..ornaments.ornaments import Floats, Ints, Mesh

_MESH = re.compile(r'^ *<mesh name="(shape_([a-z]+)_(\d+)_(\d+)_(\d+))" .*/>$', re.MULTILINE)

_ROUNDED_M = {"bevel": 0.012, "padded": 0.035, "soft": 0.045}
"""Radius of the rounded edges of boxes; soft ones bulge as well."""
_BULGE = {"bevel": 0.0, "padded": 0.12, "soft": 0.09}
"""Height of the bulge, over the shortest side, up to `_MOST_BULGE_M`."""
_MOST_BULGE_M = 0.022
_CUSHION_M = 0.75
"""Longer soft boxes, such as mattresses, lie close to others: they would let these through if they bulged."""
_ARC, _FLAT = 6, 9
"""Rows of vertices of a rounded edge, and of what lies between two of them."""
_HARD = ("block", "shade", "curtain")
"""Forms that stay as they are, or whose edges are meant to be sharp."""
_TWICE = ("bush", "sprigs", "plate")
"""Forms of thin parts: they are divided once, as rounding makes them thinner."""


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
    """Divides the triangles of a form and rounds them; returns it stretched to a cube of side 1 about the origin."""
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
    """Makes a cube from -1 to 1 with rows of vertices that are close together near its edges; edges are shared."""
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
