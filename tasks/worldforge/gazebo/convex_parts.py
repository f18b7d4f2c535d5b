"""Splits meshes into convex parts that keep their form, as MuJoCo collides the convex hull of each mesh.

Faces in one plane are joined to convex polygons, and each becomes a prism inwards, 3 cm thick or as thick as the mesh
is there. Pieces that are convex stay whole. Nothing grows: each part is inside of its mesh, give or take `_FLAT_M`,
unless the mesh is an open shell that has no inside.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from ...sdf.meshes import Triangles

THICKNESS_M = 0.03
"""Thickness of the prisms that faces become, in metres.

It is thin enough to keep the form, and thick enough that no robot passes through within a time step.
"""

_LEAST_M = 0.002
"""Smallest thickness of a convex part, in metres; MuJoCo refuses hulls without volume."""
_FLAT_M = 1e-3
"""Largest distance of corners from a plane with which they count as in it, in metres."""
_WELD_M = 1e-5
_PARALLEL = np.cos(np.radians(0.5))
_SMALLEST_M2 = 1e-4
"""Area below which faces are left out, in square metres: a square centimetre, as of screws and letters."""
_FINE_M2 = 2e-3
"""Area of connected small faces from which on they are not left out, in square metres.

A finely cut bowl or bent tube has such faces.
"""
_NARROW_M = 1e-4
"""Width of a face below which it is degenerate, in metres: MuJoCo refuses hulls of such faces."""
_FINE_PITCH_M = 0.015, 0.08
"""Smallest and largest cell of the grid of boxes that replaces fine faces, in metres."""

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BoxPart:
    """A box as convex part of a split mesh."""

    center: Points
    rotation: Points
    half: Points

    @property
    def corners(self) -> Points:
        """Returns the corners of the box, shape (8, 3)."""
        signs = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1), indexing="ij")).reshape(3, -1).T
        return self.center + (signs * self.half) @ self.rotation.T


@dataclass(frozen=True, slots=True)
class HullPart:
    """A convex hull of points as convex part of a split mesh."""

    corners: Points


ConvexPart = BoxPart | HullPart


class _Faces(NamedTuple):
    """Triangles of a mesh with equal vertices merged."""

    points: Points
    faces: NDArray[np.intp]
    normals: Points
    areas_m2: NDArray[np.float64]


class Split(NamedTuple):
    """A mesh in convex parts."""

    parts: list[ConvexPart]
    """Convex parts of the mesh, those of the largest faces first."""
    is_coarse: bool
    """Whether boxes replace faces that are too small for prisms."""


def convex_parts(triangles: Triangles, *, is_loose: bool = False) -> Split:
    """Splits a mesh into convex parts, which MuJoCo can collide.

    Args:
        triangles: The mesh.
        is_loose: Whether its body moves, so that nothing may grow: small faces become prisms, too, in place of boxes.

    Returns:
        Convex parts of the mesh; none if it is too small for a collision.
    """
    mesh = _welded(triangles)
    if not len(mesh.faces):
        return Split([], False)
    parts: list[ConvexPart] = []
    left: list[NDArray[np.intp]] = []
    for piece in _pieces(mesh):
        whole = _convex_whole(mesh, piece)
        if whole is not None:
            parts.append(whole)
        else:
            left.append(piece)
    if not left:
        return Split(parts, False)
    polygons = _polygons(mesh, np.concatenate(left))
    small = [each for each in polygons if each.area_m2 < _SMALLEST_M2]
    fine = _fine(mesh, small) if small else []
    polygons = [each for each in polygons if each.area_m2 >= _SMALLEST_M2]
    parts += _prisms(mesh, [*polygons, *(fine if is_loose else [])])
    if is_loose or not fine:
        return Split(parts, False)
    return Split([*parts, *_boxes(mesh, fine)], True)


def _welded(triangles: Triangles) -> _Faces:
    points, index = np.unique(
        np.round(triangles.reshape(-1, 3) / _WELD_M).astype(np.int64), axis=0, return_inverse=True
    )
    faces = index.reshape(-1, 3)
    corners = points[faces] * _WELD_M
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normals, axis=1)
    good = doubled > 1e-10
    faces, normals, doubled = faces[good], normals[good], doubled[good]
    # Twice the same face, from either side, is one.
    _, once = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    once = np.sort(once)
    faces, normals, doubled = faces[once], normals[once], doubled[once]
    return _Faces(
        np.asarray(points * _WELD_M, np.float64), faces.astype(np.intp), normals / doubled[:, None], doubled / 2
    )


def _pieces(mesh: _Faces) -> list[NDArray[np.intp]]:
    """Splits a mesh into pieces whose faces are connected by edges.

    A table leg that meets the top in a corner only is a piece.
    """
    count = len(mesh.faces)
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    rows = np.repeat(np.arange(count), 3)
    size = count + int(edge.max()) + 1
    graph = coo_array((np.ones(3 * count), (rows, count + edge.ravel())), shape=(size, size))
    _, labels = connected_components(graph, directed=False)
    labels = labels[:count]
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _convex_whole(mesh: _Faces, piece: NDArray[np.intp]) -> ConvexPart | None:
    """Returns a piece of a mesh as one convex part if all its faces are on its hull and close it; else `None`."""
    if len(piece) < 4:
        return None
    faces = mesh.faces[piece]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, sharing = np.unique(edges, axis=0, return_counts=True)
    if (sharing != 2).any():
        return None
    corners = mesh.points[np.unique(faces)]
    try:
        hull = ConvexHull(corners)
    except QhullError:
        return None
    # Each face's middle lies on the hull: within a millimetre of the plane nearest to it.
    middles = mesh.points[faces].mean(axis=1)
    depth = -(hull.equations[:, :3] @ middles.T + hull.equations[:, 3:]).max(axis=0)
    if (depth > _FLAT_M).any():
        return None
    extent = corners[hull.vertices]
    return _as_box(extent) or (HullPart(extent) if _thickness(hull) >= _LEAST_M else None)


def _thickness(hull: ConvexHull) -> float:
    """Returns the smallest width of a convex hull."""
    widths = -(hull.equations[:, :3] @ hull.points[hull.vertices].T + hull.equations[:, 3:]).min(axis=1)
    return float(widths.min())


def _as_box(corners: Points) -> BoxPart | None:
    """Returns the box, turned in any way, that has these corners; `None` if they form none, or one that is too thin."""
    if len(corners) != 8:
        return None
    center = corners.mean(axis=0)
    first = corners[0]
    away = np.argsort(np.linalg.norm(corners - first, axis=1))
    one, two = corners[away[1]] - first, corners[away[2]] - first
    x = one / np.linalg.norm(one)
    two = two - (two @ x) * x
    if (length := np.linalg.norm(two)) < 1e-6:
        return None
    y = two / length
    rotation = np.stack([x, y, np.cross(x, y)], axis=1)
    inside = (corners - center) @ rotation
    half = np.abs(inside).max(axis=0)
    if half.min() < _LEAST_M / 2 or (np.abs(np.abs(inside) - half) > _FLAT_M / 2).any():
        return None
    return BoxPart(center, rotation, half)


class _Polygon(NamedTuple):
    """Convex polygon formed by faces of a mesh."""

    area_m2: float
    ring: list[int]
    """Indices of the polygon's corners, counter-clockwise seen from outside."""
    normal: Points


def _polygons(mesh: _Faces, faces: NDArray[np.intp]) -> list[_Polygon]:
    """Joins faces of a mesh that are in one plane to convex polygons."""
    found: list[_Polygon] = []
    for flat in _flats(mesh, faces):
        normal = (mesh.normals[flat] * mesh.areas_m2[flat, None]).sum(axis=0)
        normal /= np.linalg.norm(normal)
        found += [_Polygon(_area(mesh.points[ring], normal), ring, normal) for ring in _joined(mesh, flat, normal)]
    return found


def _fine(mesh: _Faces, small: list[_Polygon]) -> list[_Polygon]:
    """Returns a mesh's small polygons that together form a large surface, connected by edges."""
    owner = np.repeat(np.arange(len(small)), [len(each.ring) for each in small])
    starts = np.concatenate([each.ring for each in small])
    ends = np.concatenate([each.ring[1:] + each.ring[:1] for each in small])
    edges = np.sort(np.stack([starts, ends], axis=1), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    size = len(small) + int(edge.max()) + 1
    graph = coo_array((np.ones(len(owner)), (owner, len(small) + edge.ravel())), shape=(size, size))
    _, labels = connected_components(graph, directed=False)
    areas = np.bincount(labels[: len(small)], [each.area_m2 for each in small])
    found = [each for each, label in zip(small, labels, strict=False) if areas[label] >= _FINE_M2]
    return [each for each in found if 2 * each.area_m2 > _NARROW_M * np.ptp(mesh.points[each.ring], axis=0).max()]


def _boxes(mesh: _Faces, polygons: list[_Polygon]) -> list[ConvexPart]:
    """Returns boxes on a grid that replace polygons of a mesh."""
    fans = [(ring[0], ring[at], ring[at + 1]) for _, ring, _ in polygons for at in range(1, len(ring) - 1)]
    triangles = mesh.points[np.array(fans)]
    # Cells as large as a hundredth of it, within what is fine for a robot.
    least, greatest = _FINE_PITCH_M
    return voxel_boxes(
        triangles, min(max(float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / 100, least), greatest)
    )


def _prisms(mesh: _Faces, polygons: list[_Polygon]) -> list[ConvexPart]:
    """Makes a prism of each polygon by giving it a thickness inwards, the largest polygon first."""
    polygons = sorted(polygons, key=lambda each: -each.area_m2)
    if not polygons:
        return []
    depths = _depths(mesh, polygons)
    found: list[ConvexPart] = []
    for (_, ring, normal), depth in zip(polygons, depths, strict=True):
        outer = _without_needless(mesh.points[ring], normal)
        if len(outer) >= 3:
            found.append(_prism(outer, normal, depth))
    return found


def _prism(outer: Points, normal: Points, depth: float) -> ConvexPart:
    corners = np.concatenate([outer, outer - normal * depth])
    return (_as_box(corners) if len(outer) == 4 else None) or HullPart(corners)


def _flats(mesh: _Faces, faces: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Groups faces that share edges and lie in one plane with the same side outside."""
    inside = np.sort(mesh.faces[faces][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort(inside.T)
    same = np.flatnonzero((inside[order][1:] == inside[order][:-1]).all(axis=1))
    first, second = order[same] // 3, order[same + 1] // 3
    one, other = faces[first], faces[second]
    level = (mesh.normals[one] * mesh.normals[other]).sum(axis=1) > _PARALLEL
    offset = np.abs(
        ((mesh.points[mesh.faces[other]] - mesh.points[mesh.faces[one, 0]][:, None]) * mesh.normals[one][:, None]).sum(
            2
        )
    ).max(axis=1, initial=0.0)
    joined = level & (offset < _FLAT_M)
    pairs = (first[joined], second[joined])
    graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(len(faces),) * 2)
    count, labels = connected_components(graph, directed=False)
    del count
    order = np.argsort(labels, kind="stable")
    return [faces[group] for group in np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)]


def _joined(mesh: _Faces, flat: NDArray[np.intp], normal: Points) -> list[list[int]]:
    """Joins triangles in a plane to convex polygons, over shared edges, the longest first (after Hertel, Mehlhorn)."""
    rings: dict[int, list[int]] = {number: mesh.faces[face].tolist() for number, face in enumerate(flat)}
    if len(rings) == 1:
        return list(rings.values())
    u = np.cross(normal, (1.0, 0.0, 0.0) if abs(normal[0]) < 0.9 else (0.0, 1.0, 0.0))
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    used = np.unique(mesh.faces[flat])
    spots = {
        int(point): (float(a), float(b))
        for point, a, b in zip(used, mesh.points[used] @ u, mesh.points[used] @ v, strict=True)
    }
    owners: dict[tuple[int, int], list[int]] = defaultdict(list)
    for number, ring in rings.items():
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
            owners[min(a, b), max(a, b)].append(number)
    inner = [edge for edge, both in owners.items() if len(both) == 2]
    inner.sort(key=lambda edge: -_length(spots[edge[0]], spots[edge[1]]))
    parent = list(range(len(flat)))

    def root(number: int) -> int:
        while parent[number] != number:
            parent[number] = parent[parent[number]]
            number = parent[number]
        return number

    for edge in inner:
        one, other = (root(number) for number in owners[edge])
        if one == other:
            continue
        ring = _union(rings[one], rings[other], edge)
        if ring is not None and _is_convex(ring, spots):
            rings[one] = ring
            parent[other] = one
            del rings[other]
    return list(rings.values())


def _length(one: tuple[float, float], other: tuple[float, float]) -> float:
    return (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2


def _union(one: list[int], other: list[int], edge: tuple[int, int]) -> list[int] | None:
    """Merges two polygons that share an edge; returns the corners of the result, or `None` if it would touch itself.

    The polygons run through the shared edge in opposite directions.
    """
    a, b = edge
    at = _edge_at(one, a, b)
    if at is None:
        a, b = b, a
        at = _edge_at(one, a, b)
    back = _edge_at(other, b, a)
    if at is None or back is None:
        return None
    first = one[at + 1 :] + one[: at + 1]  # begins at b, ends at a
    second = other[back + 1 :] + other[: back + 1]  # begins at a, ends at b
    ring = first + second[1:-1]
    return ring if len(set(ring)) == len(ring) else None


def _edge_at(ring: list[int], a: int, b: int) -> int | None:
    for index, point in enumerate(ring):
        if point == a and ring[(index + 1) % len(ring)] == b:
            return index
    return None


def _is_convex(ring: list[int], spots: dict[int, tuple[float, float]]) -> bool:
    """Whether a counter-clockwise polygon turns left or goes straight at every corner."""
    points = [spots[point] for point in ring]
    for index in range(len(points)):
        (x0, y0), (x1, y1), (x2, y2) = points[index - 2], points[index - 1], points[index]
        cross = (x1 - x0) * (y2 - y1) - (y1 - y0) * (x2 - x1)
        if cross < -1e-9 * (1.0 + abs(x2 - x0) + abs(y2 - y0)):
            return False
    return True


def _area(points: Points, normal: Points) -> float:
    edges = points - points[0]
    return abs(float(np.cross(edges[1:-1], edges[2:]).sum(axis=0) @ normal)) / 2


def _without_needless(points: Points, normal: Points) -> Points:
    """Removes the corners of a polygon that are on a straight edge."""
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    turn = np.cross(points - before, after - points) @ normal
    lengths = np.linalg.norm(points - before, axis=1) * np.linalg.norm(after - points, axis=1)
    return points[np.abs(turn) > 1e-6 * np.maximum(lengths, 1e-12)]


_CHUNK = 4_000_000
"""Number of (ray, triangle) pairs that are tested at a time: 100 MB of memory."""


def _depths(mesh: _Faces, polygons: list[_Polygon]) -> list[float]:
    """Returns the thickness of each polygon's prism: up to the opposite side of the mesh, if that is near.

    The nearest back side counts, from the polygon's middle and from points towards its corners.
    """
    origins, directions, owner = [], [], []
    for number, (_, ring, normal) in enumerate(polygons):
        corners = mesh.points[ring]
        middle = corners.mean(axis=0)
        spots = np.concatenate([middle[None], 0.1 * middle + 0.9 * corners])[:9]
        origins.append(spots)
        directions.append(np.repeat(-normal[None], len(spots), axis=0))
        owner += [number] * len(spots)
    hits = _first_hits(mesh, np.concatenate(origins), np.concatenate(directions))
    depths = np.full(len(polygons), THICKNESS_M)
    np.minimum.at(depths, np.array(owner), hits)
    return np.maximum(depths, _LEAST_M).tolist()


def _first_hits(mesh: _Faces, origins: Points, directions: Points) -> NDArray[np.float64]:
    """Returns distances along rays to the first back face of the mesh, up to `THICKNESS_M`.

    The distance is infinite for a ray that hits none.
    """
    corners = mesh.points[mesh.faces]
    base, one, two = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    low, high = corners.min(axis=1), corners.max(axis=1)
    found = np.full(len(origins), np.inf)
    chunk = max(1, _CHUNK // max(len(base), 1))
    for start in range(0, len(origins), chunk):
        part = slice(start, start + chunk)
        near = origins[part], origins[part] + directions[part] * THICKNESS_M
        ray_low, ray_high = np.minimum(*near) - 1e-6, np.maximum(*near) + 1e-6
        pairs = np.ones((len(ray_low), len(base)), np.bool_)
        for axis in range(3):
            pairs &= (low[None, :, axis] <= ray_high[:, None, axis]) & (high[None, :, axis] >= ray_low[:, None, axis])
        pairs &= (directions[part] @ mesh.normals.T) > 0.1
        ray, face = np.nonzero(pairs)
        if not len(ray):
            continue
        along, away = directions[part][ray], origins[part][ray] - base[face]
        cross = np.cross(along, two[face])
        scale = 1.0 / (one[face] * cross).sum(axis=1)
        u = (away * cross).sum(axis=1) * scale
        around = np.cross(away, one[face])
        v = (along * around).sum(axis=1) * scale
        t = (two[face] * around).sum(axis=1) * scale
        good = (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6) & (t > 1e-5)
        np.minimum.at(found, start + ray[good], t[good])
    return found


_MOST_SAMPLES = 20_000_000
"""Limit of the points on a surface that are sampled: some seconds. Larger meshes get larger cells."""

_MOST_CELLS = 400_000_000
"""Limit of the cells of a grid, one byte each; trees that are kilometres apart get larger cells."""


def voxel_boxes(triangles: Triangles, pitch_m: float) -> list[ConvexPart]:
    """Approximates the surface of a mesh by boxes on a grid.

    Args:
        triangles: The mesh.
        pitch_m: Side of a cell.
    """
    longest = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    extent = np.ptp(triangles.reshape(-1, 3), axis=0)
    while ((longest / pitch_m * 3 + 1) ** 2).sum() / 2 > _MOST_SAMPLES or np.prod(extent / pitch_m + 2.0) > _MOST_CELLS:
        pitch_m *= 1.5
    cells = _surface_cells(triangles, longest, pitch_m)
    low = cells.min(axis=0)
    grid = np.zeros(cells.max(axis=0) - low + 1, np.bool_)
    grid[tuple((cells - low).T)] = True
    found: list[ConvexPart] = []
    for start, size in _merged_boxes(grid):
        half = np.array(size) * pitch_m / 2
        found.append(BoxPart((np.array(start) + low) * pitch_m + half, np.eye(3), half))
    return found


def _surface_cells(triangles: Triangles, longest: NDArray[np.float64], pitch_m: float) -> NDArray[np.int64]:
    """Returns the grid cells that triangles pass through, from points on them a third of a cell apart."""
    step = pitch_m / 3
    counts = np.maximum(np.ceil(longest / step).astype(int), 1)
    found: list[NDArray[np.int64]] = []
    for count in np.unique(counts):
        some = triangles[counts == count]
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        keep = i + j <= count
        a, b = i[keep] / count, j[keep] / count
        weights = np.stack([1 - a - b, a, b], axis=1)
        per = max(1, 500_000 // len(weights))
        for start in range(0, len(some), per):
            spots = np.einsum("wk,tkc->twc", weights, some[start : start + per]).reshape(-1, 3)
            found.append(np.unique(np.floor(spots / pitch_m).astype(np.int64), axis=0))
    return np.unique(np.concatenate(found), axis=0)


def _merged_boxes(grid: NDArray[np.bool_]) -> list[tuple[tuple[int, int, int], tuple[int, int, int]]]:
    """Covers the set cells of a grid with boxes: each grows as far as it can, upwards last.

    Each box is its lowest cell, and its numbers of cells along x, y and z.
    """
    found = []
    left = grid.copy()
    for x, y, z in np.argwhere(grid):
        if not left[x, y, z]:
            continue
        x1 = x + 1
        while x1 < grid.shape[0] and left[x1, y, z]:
            x1 += 1
        y1 = y + 1
        while y1 < grid.shape[1] and left[x:x1, y1, z].all():
            y1 += 1
        z1 = z + 1
        while z1 < grid.shape[2] and left[x:x1, y:y1, z1].all():
            z1 += 1
        left[x:x1, y:y1, z:z1] = False
        found.append(((int(x), int(y), int(z)), (int(x1 - x), int(y1 - y), int(z1 - z))))
    return found
