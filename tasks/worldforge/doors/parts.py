"""Parts of doors: leaves with panels, glass or boards, handles, and the frames around them.

A leaf's parts are in its own frame: its x axis starts at the hinge and points to the free edge, z starts at the floor.
"""

from collections.abc import Iterator

from ....schemas.worlds.world import Door, Passage, Wall
from ..furniture.solids import Solid
from ..geometry.parts import CHROME, WHITE, Color, Part, Span, box, rgb

FORMS = ("flush", "panelled", "glazed", "boarded")
MASS_KG = {"flush": 16.0, "panelled": 20.0, "glazed": 24.0, "boarded": 22.0}
"""Mass of the leaf without its handles, by form, in kilograms."""
HANDLE_KG = 0.2

_FINISHES: dict[str, tuple[Color, Color]] = {
    "white": (WHITE, rgb("faf9f6")),
    "oak": (rgb("c89f6d"), rgb("d6ae7c")),
    "walnut": (rgb("7a5436"), rgb("87603f")),
    "grey": (rgb("8d9196"), rgb("999da2")),
    "sage": (rgb("8ea58c"), rgb("9ab097")),
}
FINISHES = tuple(_FINISHES)
_PANE = rgb("cfe0e8")

_RELIEF_M = 0.006
_HANDLE_HEIGHT_M = 1.05
_HANDLE_INSET_M = 0.07
_LEVER_M = 0.12
_LEVER_OFF_M = 0.055

_CASING_M = 0.06
_CASING_THICK_M = 0.012


def door_parts(door: Door) -> list[Part]:
    """The leaf and what is on it."""
    form, _, finish = door.style.partition(" ")
    main, accent = _FINISHES.get(finish, _FINISHES["white"])
    low, high = door.bottom_m, door.bottom_m + door.leaf_height_m
    leaf = box("leaf", (0.0, door.leaf_width_m), _across(door, 0.0, door.thickness_m), (low, high), main, solid=True)
    parts = [leaf]
    for face in ("front", "back"):
        relief = _off(door, face, 0.0, _RELIEF_M)
        parts += [
            box(f"{name}-{face}", x, relief, z, color)
            for name, x, z, color in _relief(form, door.leaf_width_m, (low, high), accent)
        ]
        parts += _handle(door, face)
    return parts


def _relief(form: str, width: float, height: Span, accent: Color) -> Iterator[tuple[str, Span, Span, Color]]:
    """Raised parts of a leaf's face: name, extent along the leaf, extent upwards, colour."""
    low, high = height
    if form == "panelled":
        edge = (0.12, width - 0.12)
        yield "panel-low", edge, (low + 0.2, low + 0.9), accent
        yield "panel-high", edge, (low + 1.12, high - 0.12), accent
    elif form == "glazed":
        yield "panel-low", (0.12, width - 0.12), (low + 0.2, low + 0.75), accent
        yield "pane", (0.12, width - 0.12), (low + 0.95, high - 0.12), _PANE
    elif form == "boarded":
        board = width / 5
        for number in range(5):
            yield (
                f"board-{number + 1}",
                (number * board + 0.005, (number + 1) * board - 0.005),
                (low + 0.01, high - 0.01),
                accent,
            )


def _handle(door: Door, face: str) -> list[Part]:
    """A lever, which collides, and its plate, which does not."""
    end = door.leaf_width_m - _HANDLE_INSET_M
    up = (_HANDLE_HEIGHT_M - 0.01, _HANDLE_HEIGHT_M + 0.01)
    return [
        box(
            f"plate-{face}",
            (end - 0.02, end + 0.02),
            _off(door, face, 0.0, _RELIEF_M + 0.004),
            (_HANDLE_HEIGHT_M - 0.11, _HANDLE_HEIGHT_M + 0.05),
            CHROME,
        ),
        box(f"neck-{face}", (end - 0.01, end + 0.01), _off(door, face, 0.0, _LEVER_OFF_M - 0.015), up, CHROME),
        box(
            f"handle-{face}",
            (end - _LEVER_M, end + 0.01),
            _off(door, face, _LEVER_OFF_M - 0.015, _LEVER_OFF_M),
            up,
            CHROME,
            solid=True,
        ),
    ]


def _across(door: Door, near: float, far: float) -> Span:
    """Between two depths into the leaf, from its face in the room."""
    one, other = sorted((-door.swing * near, -door.swing * far))
    return one, other


def _off(door: Door, face: str, near: float, far: float) -> Span:
    """Between two distances off a face."""
    if face == "front":
        return _across(door, -near, -far)
    return _across(door, door.thickness_m + near, door.thickness_m + far)


def frame_solids(number: int, passage: Passage, lintel: Wall) -> Iterator[Solid]:
    """The casing around a doorway, on both faces of its wall; for the eye only.

    Args:
        number: the doorway's, for the names.
        passage: the doorway.
        lintel: the piece of wall over it.
    """
    door = passage.door
    color = _FINISHES.get(door.style.partition(" ")[2], _FINISHES["white"])[0] if door else WHITE
    (x0, y0), (x1, y1) = passage.start, passage.end
    along_x = abs(x1 - x0) > abs(y1 - y0)
    low, high = sorted((x0, x1) if along_x else (y0, y1))
    at, top = (y0 if along_x else x0), lintel.bottom_m
    pieces = {
        "left": ((low - _CASING_M, low), (0.0, top + _CASING_M)),
        "right": ((high, high + _CASING_M), (0.0, top + _CASING_M)),
        "head": ((low, high), (top, top + _CASING_M)),
    }
    for side, sign in (("front", 1), ("back", -1)):
        across = at + sign * (lintel.thickness_m + _CASING_THICK_M) / 2
        for name, (span, up) in pieces.items():
            along, height = sum(span) / 2, sum(up) / 2
            length = span[1] - span[0]
            center = (along, across, height) if along_x else (across, along, height)
            size = (length, _CASING_THICK_M, up[1] - up[0]) if along_x else (_CASING_THICK_M, length, up[1] - up[0])
            yield Solid(f"doorframe_{number}_{name}_{side}", "box", center, size, "z", 0.0, color, False)
