"""Walls of rooms of any rectilinear shapes: no two overlap, and nothing gets through but by ways."""

import numpy as np
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from prefect_robomaker.tasks.worldforge.drawings.squaring import outline_of, overlaps, square, upright
from prefect_robomaker.tasks.worldforge.floorplans.partition import Corners, area
from prefect_robomaker.tasks.worldforge.floorplans.walls import Piece, Walls, room_units

SIZE = 3


def box(x0: int, y0: int, x1: int, y1: int) -> Corners:
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


@st.composite
def plans(draw: st.DrawFn) -> list[Corners]:
    """Cells of an uneven grid, some of them missing, some joined into an L or a bar."""
    steps = st.lists(st.integers(20, 60), min_size=SIZE, max_size=SIZE)
    xs, ys = (np.cumsum([0, *draw(steps)]).tolist() for _ in range(2))
    kept = draw(st.lists(st.integers(0, 4), min_size=SIZE * SIZE, max_size=SIZE * SIZE))
    cells = [
        box(xs[i], ys[j], xs[i + 1], ys[j + 1])
        for j in range(SIZE)
        for i in range(SIZE)
        if kept[SIZE * j + i] or i == j
    ]
    merged = draw(st.integers(0, min(3, len(cells))))
    joined = outline_of(Walls(cells[:merged]).around) if merged > 1 else ()
    if joined and area(joined) == sum(area(cell) for cell in cells[:merged]) and len({*joined}) == len(joined):
        return [joined, *cells[merged:]]
    return cells


def covered(piece: Piece) -> tuple[slice, slice]:
    half, off = piece.thickness // 2, 10
    along = slice(piece.start + off, piece.end + off)
    across = slice(piece.at - half + off, piece.at + half + off)
    return (across, along) if piece.horizontal else (along, across)


@given(plans())
@examples(60)
def test_walls_close_every_room_and_never_overlap(rooms: list[Corners]) -> None:
    pieces = Walls(rooms).pieces([])
    times = np.zeros((20 + 60 * SIZE, 20 + 60 * SIZE), int)
    for piece in pieces:
        assert piece.end > piece.start
        times[covered(piece)] += 1
    assert times.max() == 1
    # Also diagonally: a gap at a corner would join two parts.
    labels = ndimage.label(times == 0, np.ones((3, 3)))[0]  # pyright: ignore[reportIndexIssue]
    owners = [set(np.unique(labels[10:, 10:][inside_of(corners)])) - {0} for corners in rooms]
    assert all(len(parts) == 1 for parts in owners)
    outside = ndimage.binary_dilation(labels == labels[0, 0], np.ones((3, 3)))
    assert not any(outside[covered(piece)].any() for piece in pieces if len(piece.rooms) == 2), "outer walls go on"
    assert len({*labels[[0], :].ravel(), *(part for parts in owners for part in parts)}) == 1 + len(rooms)


def inside_of(corners: Corners) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.nonzero(room_units(corners))
    return rows + min(y for _, y in corners), columns + min(x for x, _ in corners)


@given(plans(), st.integers(0, 8), st.sampled_from([1, -1]))
@examples(60)
def test_rooms_drawn_with_gaps_for_walls_meet_where_they_would(rooms: list[Corners], gap: int, turn: int) -> None:
    """Rooms are shrunk by half a gap on each side, as drawings have them, in any order of corners."""
    half = gap / 2 / 20
    drawn = []
    for corners in rooms:
        inner = []
        for index, (x, y) in enumerate(corners):
            (u, v), (p, q) = corners[index - 1], corners[(index + 1) % len(corners)]
            # To the left of both edges at the corner.
            inner.append((x / 20 + half * np.sign((v - y) + (y - q)), y / 20 + half * np.sign((x - u) + (p - x))))
        drawn.append(upright(inner[::turn], "room", inner[::turn]))
    squared = square(drawn, on_faces=False)
    assert not list(overlaps(squared.rooms))
    assert all(area(corners) > 0 for corners in squared.rooms), "counter-clockwise"
    if gap == 0:
        first = min(x for corners in rooms for x, _ in corners), min(y for corners in rooms for _, y in corners)
        assert [set(corners) for corners in squared.rooms] == [
            {(x - first[0], y - first[1]) for x, y in corners} for corners in rooms
        ]
    inner_walls = len(Walls(rooms).contacts)
    assert len(Walls(squared.rooms).contacts) >= inner_walls
