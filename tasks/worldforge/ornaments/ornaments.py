"""Ornaments: geoms that are only drawn, and their procedural meshes."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.parts import Color, Vector

MESHES_FOLDER = "meshes"
"""Folder of a decorated model's textured meshes, beside the model."""

VISUAL = 'contype="0" conaffinity="0" group="2" mass="0"'

_HALF = f"{sqrt(0.5):.6f}"
# Local axes are along, up, through: pictures are projected along the last.
ALONG_X = f"{_HALF} {_HALF} 0 0"
ALONG_Y = "0.5 0.5 0.5 0.5"
CYLINDER_QUAT = {"x": f"{_HALF} 0 {_HALF} 0", "y": f"{_HALF} {_HALF} 0 0", "z": ""}

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]


class _Texts(dict[float, str]):
    """Cache of formatted numbers: sizes and heights of objects recur."""

    # `lru_cache` takes four times as long to find one, and a world's file has ten thousand.
    def __missing__(self, value: float) -> str:
        if len(self) >= _MOST_TEXTS:
            self.clear()
        text = self[value] = f"{round(value, 4) + 0.0:g}"
        return text


class _StepTexts(dict[float, str]):
    """Cache of formatted numbers by the number of ten-thousandths: a third as many entries as mesh coordinates."""

    def __missing__(self, steps: float) -> str:
        if len(self) >= _MOST_TEXTS:
            self.clear()
        text = self[steps] = f"{steps / _STEPS + 0.0:g}"
        return text


_MOST_TEXTS = 1 << 15
"""Limit of cached number texts; some 4 MB."""

_STEPS = 1e4
"""Steps of a written number per unit: MJCF has four decimals, a tenth of a millimetre."""

_NEAR_HALF = 1e-6
"""Distance from the middle between two steps below which rounding is unsure.

It is a hundred times the error of a product up to 10 km.
"""

_text_of = _Texts().__getitem__
_text_of_steps = _StepTexts().__getitem__


def numbers(*values: float) -> str:
    """Formats numbers for MJCF."""
    return " ".join(map(_text_of, values))


def number_texts(values: Floats) -> Iterator[str]:
    """Yields the texts of many numbers, each as `numbers` has it, in half the time.

    Args:
        values: Shape (n,), each below 10 km.
    """
    products = values * _STEPS
    steps = np.rint(products)
    # `round` knows on which side of the middle a number is, and multiplying does not.
    for at in np.flatnonzero(np.abs(np.abs(products - steps) - 0.5) < _NEAR_HALF).tolist():
        steps[at] = round(round(float(values[at]), 4) * _STEPS)
    return map(_text_of_steps, steps.tolist())


class Ornament(NamedTuple):
    """A decorative geom that never collides."""

    name: str
    """Name of a decorative geom that is unique in the world."""
    kind: str
    """Type of a decorative geom: `box`, `cylinder` or `mesh`."""
    center: Vector
    size: Sequence[float]
    """Half extents of a decorative geom as in MJCF; empty for a mesh."""
    look: str
    """MJCF attribute of a decorative geom's look: `rgba` or `material`."""
    quat: str = ""
    """MJCF attribute of a decorative geom's rotation; empty: none."""
    mesh: str = ""
    """Name of a decorative geom's mesh asset."""

    def line(self) -> str:
        """Returns the decorative geom as MJCF."""
        turn = f' quat="{self.quat}"' if self.quat else ""
        form = f'mesh="{self.mesh}"' if self.mesh else f'size="{numbers(*self.size)}"'
        place = f'pos="{numbers(*self.center)}"{turn}'
        return f'    <geom name="{self.name}" type="{self.kind}" {place} {form} {self.look} {VISUAL}/>'


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangle mesh of a decoration; triangles are counter-clockwise seen from outside."""

    vertices: Floats
    """Vertex positions in metres, shape (n, 3)."""
    triangles: Ints
    """Vertex indices of the triangles, shape (m, 3)."""
    places: Floats | None = None
    """Texture coordinates of the vertices, shape (n, 2): repetitions to the right and down; `None`: no texture."""

    def line(self, name: str) -> str:
        """Returns the mesh as an MJCF asset.

        A textured mesh is a file: MuJoCo before 3.1.6 crashes on texture coordinates within MJCF.
        """
        if self.places is not None:
            return f'    <mesh name="{name}" file="{mesh_path(name)}"/>'
        faces = _faces(self.triangles.astype(np.int64).tobytes())
        return f'    <mesh name="{name}" vertex="{_list(self.vertices)}" face="{faces}"/>'

    def obj_text(self) -> str:
        """Returns the textured mesh as a Wavefront OBJ file."""
        assert self.places is not None
        lines = [f"v {x} {y} {z}" for x, y, z in zip(*_texts(self.vertices), strict=True)]
        right, up = _texts(np.stack([self.places[:, 0], 1 - self.places[:, 1]], axis=1))
        lines += [f"vt {u} {v}" for u, v in zip(right, up, strict=True)]
        lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in (self.triangles + 1).tolist()]
        return "\n".join([*lines, ""])


@lru_cache(maxsize=64)
def _faces(triangles: bytes) -> str:
    """Formats the vertex indices of triangles; cached, as meshes of one form have the same ones at every size."""
    return " ".join(map(str, np.frombuffer(triangles, np.int64).tolist()))


def mesh_path(name: str) -> str:
    """Returns the path of a decorative mesh's file, relative to the model."""
    return f"{MESHES_FOLDER}/{name}.obj"


def _texts(values: Floats) -> Iterator[Iterator[str]]:
    """Yields the formatted numbers of each column of an array."""
    return map(number_texts, values.T)


def _list(values: Floats) -> str:
    return " ".join(number_texts(values.ravel()))


def color_look(color: Color) -> str:
    """Returns the MJCF attributes of a plain colour."""
    return f'rgba="{numbers(*color)}"'


def sheet(corner: Vector, along: Vector, up: Vector, cells: tuple[int, int]) -> tuple[Floats, Ints]:
    """Makes a parallelogram mesh divided into cells: vertices and triangles.

    `cells` are their numbers along and up. MuJoCo computes light at vertices only, so surfaces under lamps need some.
    """
    across, upwards, triangles = _grid(*cells)
    return np.array(corner) + across * np.array(along) + upwards * np.array(up), triangles


@lru_cache(maxsize=256)
def _grid(columns: int, rows: int) -> tuple[Floats, Floats, Ints]:
    """Returns the position of each corner of a sheet's cells (shares along and up, shape (n, 1)), and the triangles."""
    i, j = (axis.reshape(-1, 1) for axis in np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)))
    first = np.arange(columns + 1 - 1) + (columns + 1) * np.arange(rows)[:, None]
    a = first.ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    triangles.flags.writeable = False
    return i / columns, j / rows, triangles


def joined(parts: Iterable[tuple[Floats, Ints]]) -> tuple[Floats, Ints]:
    """Joins several meshes, each vertices and triangles, into one."""
    vertices, triangles, count = [], [], 0
    for points, faces in parts:
        vertices.append(points)
        triangles.append(faces + count)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(triangles)


def turned_open(profile: Sequence[tuple[float, float]], sections: int) -> Mesh:
    """Makes a surface of revolution about z from a profile of radii and heights, from the bottom up.

    It is closed at the bottom and open at the top. Lengths are in the profile's unit.
    """
    angles = np.arange(sections) * (2 * np.pi / sections)
    rings = [(radius, height) for radius, height in profile if radius > 0]
    vertices = [np.array([[0.0, 0.0, profile[0][1]]])]
    vertices += [
        np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(sections, height)], axis=1)
        for radius, height in rings
    ]
    here = 1 + np.arange(sections)
    after = 1 + (np.arange(sections) + 1) % sections
    faces = [np.stack([np.zeros(sections, np.int64), after, here], axis=1)]
    for ring in range(len(rings) - 1):
        a, b = here + ring * sections, after + ring * sections
        faces += [np.stack([a, b, b + sections], axis=1), np.stack([a, b + sections, a + sections], axis=1)]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))
