"""A picture of a furnished world from above, drawn without any graphics driver.

The walls are cut a little above a metre, like a dolls' house whose upper half has been lifted off. The
pixels depend on the world alone: not on the machine, its display or its number of processors.
"""

import io
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage
from PIL import ImageFilter

from ....schemas.worlds.world import Furniture, Room, Wall, Window, World, bounds, contains
from ..decor.faces import wall_span, walls_of_windows, window_heights, windows_in
from ..doors.door_parts import cut_door_solids
from ..furniture.placed_parts import Solid, solids_of, turn
from ..geometry.boxes import Box, room_rects
from ..geometry.parts import Color, Span, Vector, rgb
from ..materials.materials import surface_name
from ..materials.textures import sample
from ..model.mjcf import wall_surfaces
from .preview_labels import with_labels
from .preview_raster import CUT, Block, Image, LightMap, Palette, Raster, View
from .preview_things import RUG, things_from_above
from .room_looks import THRESHOLD_COLOR, has_joint, threshold

WIDTH, HEIGHT = 960, 720
"""Width and height of the preview picture, in pixels."""

_SUPERSAMPLING = 2
_AZIMUTH_DEG, _ELEVATION_DEG = -24.0, 60.0
_CUT_M, _NEAR_CUT_M = 1.2, 0.4
"""Heights at which walls are cut, in metres: above the sills of windows, and low where they would hide rooms."""
_FURNITURE_CUT_M = 1.3
"""Height at which furniture is cut, in metres, so that wardrobes and fridges do not hide the rooms behind them."""
_WHOLE = ("FloorLamps",)
"""Kinds of furniture that are not cut, as they are known by their upper ends."""
_PLINTHS = (".plinth", ".feet")
"""Ends of the names of parts that are set back below furniture: as lines thinner than a pixel they would be dotted."""
_RAISED_M = 0.6
"""Height in metres above which the underside of a thing is too high for it to darken the floor below it."""
_BAND_ROWS = 48
"""Rows of a picture that are lit at once: what is known of them stays near the processor."""
_MARGIN = 0.055
_OUTSIDE = "wall_outside"
_FRAME_COLOR, _PANE_COLOR = rgb("f4f4f2"), rgb("b9d6e2")
_VEIL, _VEIL_SHARE = np.array((176.0, 212.0, 230.0), np.float32), 0.6
"""Colour of panes of glass, and its share in what is seen through them."""
_PROFILE_M, _FRAME_DEEP_M, _MULLION_FROM_M = 0.055, 0.08, 1.1
"""Width and depth of the bars of window frames, and width from which a window has two panes, in metres."""
_SIGN_SHADE = 0.62
"""Share of light on the outlines of windows' signs in walls."""
_EDGE_M = 0.06
_LINE, _CUT_LINE = 130, 120
"""Losses of light, of 255, on the outlines of things, half a pixel wide, and of cut walls, a pixel wide."""
_OVER_M = 0.004

Colors = NDArray[np.uint8]


def render_preview(world: World, *, named: bool = True) -> bytes:
    """Renders a preview picture of a world from above at an angle.

    Args:
        world: The world.
        named: Whether rooms have labels with name and area; they cannot be read in a picture shown at a third of its
            size.

    Returns:
        A PNG of 960 x 720 pixels.
    """
    raster = Raster(_view(world))
    palette = Palette()
    blocks, floors = _draw_building(world, raster, palette)
    for item in world.furniture:
        for solid in _cut_solids(item):
            _draw_solid(solid, raster, palette)
            if solid.size[2] > 0.015 and solid.center[2] - solid.size[2] / 2 < _RAISED_M:
                blocks.append(_block(solid))
    for solid in things_from_above(world):
        if solid.center[2] < _FURNITURE_CUT_M:
            first = palette.count
            _draw_solid(solid, raster, palette)
            room = _room_of_rug(solid, world)
            if room:
                floors |= dict.fromkeys(range(first, palette.count), room)
    for solid in cut_door_solids(world.floorplan, _CUT_M):
        _draw_solid(solid, raster, palette)
    for number, wall in sorted(walls_of_windows(world).items()):
        _draw_panes(world.floorplan.windows[number], wall, world, raster)
    colors = np.take(palette.table(), raster.ids, axis=0)
    _lay_patterns(raster, palette, colors)
    _veil(raster, colors)
    lit = _lit(colors, raster, palette, LightMap.of(blocks, bounds(world.floorplan.footprint)))
    _draw_outlines(raster, lit)
    shown = with_labels(lit, raster.ids[::_SUPERSAMPLING, ::_SUPERSAMPLING], floors) if named else lit
    picture = PilImage.fromarray(shown)
    buffer = io.BytesIO()
    picture.save(buffer, format="PNG", compress_level=2)
    return buffer.getvalue()


def _view(world: World) -> View:
    """Returns the camera view that shows the whole building, as large as it fits."""
    unit = View(_AZIMUTH_DEG, _ELEVATION_DEG, 1.0, (0.0, 0.0), (1, 1))
    wall = 0.15
    corners = [
        unit.point((x + across, y + away, z))
        for x, y in world.floorplan.footprint
        for across in (-wall, wall)
        for away in (-wall, wall)
        for z in (0.0, 1.2)
    ]
    left, right = min(c[0] for c in corners), max(c[0] for c in corners)
    top, bottom = min(c[1] for c in corners), max(c[1] for c in corners)
    width, height = WIDTH * _SUPERSAMPLING, HEIGHT * _SUPERSAMPLING
    scale = (1 - 2 * _MARGIN) * min(width / (right - left), height / (bottom - top))
    offset = (width / 2 - scale * (left + right) / 2, height / 2 - scale * (top + bottom) / 2)
    return View(_AZIMUTH_DEG, _ELEVATION_DEG, scale, offset, (width, height))


def _cut_solids(item: Furniture) -> list[Solid]:
    """Returns the drawn solids of a piece of furniture, cut at the preview's height; some kinds stay whole."""
    drawn = [solid for solid in solids_of(item) if solid.drawn and not solid.name.endswith(_PLINTHS)]
    if item.model_type in _WHOLE or item.base_m + item.height_m <= _FURNITURE_CUT_M:
        return drawn
    cut: list[Solid] = []
    for solid in drawn:
        (x, y, z), (sx, sy, sz) = solid.center, solid.size
        bottom, top = z - sz / 2, min(z + sz / 2, _FURNITURE_CUT_M)
        if bottom < _FURNITURE_CUT_M:
            cut.append(solid._replace(center=(x, y, (bottom + top) / 2), size=(sx, sy, top - bottom)))
    return cut


def _room_of_rug(solid: Solid, world: World) -> Room | None:
    """Returns the room of a rug, which labels may lie on as on its floor; `None` for other things."""
    if not solid.name.startswith(RUG):
        return None
    return next((room for room in world.floorplan.rooms if contains(room.polygon, *solid.center[:2])), None)


def _draw_building(world: World, raster: Raster, palette: Palette) -> tuple[list[Block], dict[int, Room]]:
    """Draws floors, walls and windows; returns the parts that cast shadows, and the rooms by their floors' colours.

    Floors, walls and windows are drawn into `raster`, and their colours are added to `palette`.
    """
    blocks: list[Block] = []
    floors: dict[int, Room] = {}
    for room in world.floorplan.rooms:
        floor_color = palette.add_floor(surface_name("floor", room))
        floors[floor_color] = room
        for x0, y0, x1, y1 in room_rects(room):
            raster.parallelogram((x0, y0, 0.0), (x1 - x0, 0, 0), (0, y1 - y0, 0), floor_color)
    for passage in world.floorplan.passages:
        if has_joint(passage, world):
            west, south, east, north = threshold(passage)
            strip_color = palette.add((*THRESHOLD_COLOR, 1.0))
            raster.parallelogram((west, south, _OVER_M), (east - west, 0, 0), (0, north - south, 0), strip_color)
    for wall in world.floorplan.walls:
        if wall.bottom_m < _CUT_M:
            blocks += _draw_wall(wall, world, raster, palette)
    for number, wall in sorted(walls_of_windows(world).items()):
        _draw_window(world.floorplan.windows[number], wall, world, raster, palette)
    return blocks, floors


def _top_m(wall: Wall, world: World) -> float:
    """Returns the height in metres at which a wall is cut: low for outer ones in south or west, which hide others."""
    right, left = wall_surfaces(wall, world)
    forward = wall.end[0] > wall.start[0] or wall.end[1] < wall.start[1]  # south or west of it lies to its right
    return _NEAR_CUT_M if wall.exterior and (right if forward else left) == _OUTSIDE else _CUT_M


def _draw_wall(wall: Wall, world: World, raster: Raster, palette: Palette) -> Iterator[Block]:
    """Draws a wall, up to the sills of its windows where it is cut above them; yields its parts for shadows."""
    right, left = wall_surfaces(wall, world)
    along_x, at, (low, high) = wall_span(wall)
    forward = wall.end[0] > wall.start[0] if along_x else wall.end[1] > wall.start[1]
    before, behind = (right, left) if forward == along_x else (left, right)
    sides = {"south": before, "north": behind} if along_x else {"west": before, "east": behind}
    ends = {"east": _OUTSIDE, "west": _OUTSIDE} if along_x else {"south": _OUTSIDE, "north": _OUTSIDE}
    top, sill = _top_m(wall, world), window_heights(world)[0]
    spans = [span for _, span in windows_in(wall, world)] if top > sill else []
    edges = [low, *(edge for span in spans for edge in span), high]
    for number, (start, end) in enumerate(pairwise(edges)):
        upper = sill if number % 2 else top
        west, south, east, north = _strip(along_x, at, (start, end), wall.thickness_m / 2)
        if end > start:
            _draw_box(raster, palette, (west, south, 0.0), (east, north, upper), CUT, sides | ends)
            yield Block(west, south, east, north, upper)


def _strip(along_x: bool, at: float, span: Span, half: float) -> Box:
    """Returns the rectangle along a line, up to a distance from it to both sides."""
    return (span[0], at - half, span[1], at + half) if along_x else (at - half, span[0], at + half, span[1])


def _draw_window(window: Window, wall: Wall, world: World, raster: Raster, palette: Palette) -> None:
    """Draws a window's frame on its sill, or its sign in a floor plan on a wall that is cut below it."""
    along_x, at, (low, high) = wall_span(window)
    top, sill = _top_m(wall, world), window_heights(world)[0]
    if top < sill:
        quarter, line = wall.thickness_m / 4, _PROFILE_M / 2
        frame, pane = palette.add(_FRAME_COLOR, _SIGN_SHADE), palette.add(_PANE_COLOR)
        for half, inset, height, color in ((quarter + line, 0.0, 1, frame), (quarter, line, 2, pane)):
            west, south, east, north = _strip(along_x, at, (low + inset, high - inset), half)
            corner = (west, south, top + height * _OVER_M)
            raster.parallelogram(corner, (east - west, 0, 0), (0, north - south, 0), color)
        return
    for start, end in _bars(low, high):
        west, south, east, north = _strip(along_x, at, (start, end), _FRAME_DEEP_M / 2)
        _draw_box(raster, palette, (west, south, sill), (east, north, top), _FRAME_COLOR, {})
    west, south, east, north = _strip(along_x, at, (low, high), _FRAME_DEEP_M / 2)
    _draw_box(raster, palette, (west, south, sill), (east, north, sill + _PROFILE_M), _FRAME_COLOR, {})


def _bars(low: float, high: float) -> Iterator[Span]:
    """Yields the upright bars of a window's frame, by their ends along the wall."""
    panes = 1 if high - low < _MULLION_FROM_M else 2
    for number in range(panes + 1):
        start = low + (high - low - _PROFILE_M) * number / panes
        yield start, start + _PROFILE_M


def _draw_panes(window: Window, wall: Wall, world: World, raster: Raster) -> None:
    """Draws a window's glass, if its wall is cut above the sill, before everything that is drawn already."""
    along_x, at, (low, high) = wall_span(window)
    top, sill = _top_m(wall, world), window_heights(world)[0]
    if top > sill:
        corner = (low, at, sill) if along_x else (at, low, sill)
        wide = (high - low, 0.0, 0.0) if along_x else (0.0, high - low, 0.0)
        raster.pane(corner, wide, (0.0, 0.0, top - sill))


def _draw_solid(solid: Solid, raster: Raster, palette: Palette) -> None:
    (x, y, z), (sx, sy, sz) = solid.center, solid.size
    if solid.shape == "ellipsoid":
        raster.ball(solid.center, (sx / 2, sy / 2, sz / 2), palette.add_curved(solid.color))
    elif solid.shape == "cylinder" and solid.axis == "z":
        raster.post((x, y, z - sz / 2), sx / 2, sz, palette.add_curved(solid.color))
        raster.disc((x, y, z + sz / 2), (sx / 2, 0, 0), (0, sy / 2, 0), palette.add(solid.color))
    elif solid.shape == "cylinder" and sz > 0.1:
        _draw_round_front(solid, raster, palette)
    elif solid.color[3] < 1:
        _draw_glass(solid, raster, palette)
    elif solid.yaw == 0.0:
        low, high = (x - sx / 2, y - sy / 2, z - sz / 2), (x + sx / 2, y + sy / 2, z + sz / 2)
        _draw_box(raster, palette, low, high, solid.color, {})
    else:
        _draw_turned_box(solid, raster, palette)


def _draw_box(
    raster: Raster, palette: Palette, low: Vector, high: Vector, color: Color | int, sides: dict[str, str]
) -> None:
    """Draws the top and the two sides of a box that the camera sees.

    Args:
        raster: Where it is drawn.
        palette: Its colours are added to it.
        low: The corner in the south-west and below.
        high: The corner across from it.
        color: Colour, or number of the top's colour if `sides` names all sides.
        sides: Surfaces of a wall's sides, which are called `south`, `east` and `west`; others have the plain colour.
    """

    def side(name: str, normal: tuple[float, float]) -> int:
        if isinstance(color, int) or name in sides:
            return palette.add_wall(sides[name], normal)
        return palette.add_side(color, normal)

    dx, dy, dz = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    top = color if isinstance(color, int) else palette.add(color)
    raster.parallelogram((low[0], low[1], high[2]), (dx, 0, 0), (0, dy, 0), top)
    raster.parallelogram(low, (dx, 0, 0), (0, 0, dz), side("south", (0, -1)))
    if _AZIMUTH_DEG > 0:
        raster.parallelogram((high[0], low[1], low[2]), (0, dy, 0), (0, 0, dz), side("east", (1, 0)))
    else:
        raster.parallelogram(low, (0, dy, 0), (0, 0, dz), side("west", (-1, 0)))


def _draw_turned_box(solid: Solid, raster: Raster, palette: Palette) -> None:
    """Draws the top and all four vertical sides of a turned box (yaw not 0); the depth buffer hides the far sides."""
    c, s = (round(value, 9) for value in turn(solid.yaw))
    (x, y, z), (sx, sy, sz) = solid.center, solid.size
    along, across, up = (sx * c, sx * s, 0.0), (-sy * s, sy * c, 0.0), (0.0, 0.0, sz)
    corner = (x - (along[0] + across[0]) / 2, y - (along[1] + across[1]) / 2, z - sz / 2)
    top = (corner[0], corner[1], z + sz / 2)
    raster.parallelogram(top, along, across, palette.add(solid.color))
    for start, edge, normal in (
        (corner, along, (s, -c)),
        (corner, across, (-c, -s)),
        ((corner[0] + across[0], corner[1] + across[1], corner[2]), along, (-s, c)),
        ((corner[0] + along[0], corner[1] + along[1], corner[2]), across, (c, s)),
    ):
        raster.parallelogram(start, edge, up, palette.add_side(solid.color, normal))


def _draw_round_front(solid: Solid, raster: Raster, palette: Palette) -> None:
    """Draws the end face of a lying cylinder that faces the camera, such as the door of a washing machine."""
    (x, y, z), (sx, sy, sz) = solid.center, solid.size
    if solid.axis == "y":
        raster.disc((x, y - sy / 2, z), (sx / 2, 0, 0), (0, 0, sz / 2), palette.add_side(solid.color, (0, -1)))
    else:
        side = 1 if _AZIMUTH_DEG > 0 else -1
        end = (x + side * sx / 2, y, z)
        raster.disc(end, (0, sy / 2, 0), (0, 0, sz / 2), palette.add_side(solid.color, (side, 0)))


def _draw_glass(solid: Solid, raster: Raster, palette: Palette) -> None:
    """Draws a pane of glass as its rim only: the rest is transparent."""
    (x, y, z), (sx, sy, sz) = solid.center, solid.size
    low, high, rim = (x - sx / 2, y - sy / 2, z - sz / 2), (x + sx / 2, y + sy / 2, z + sz / 2), 0.03
    color = (*solid.color[:3], 1.0)
    _draw_box(raster, palette, (low[0], low[1], high[2] - rim), high, color, {})
    if sx > sy:
        _draw_box(raster, palette, low, (low[0] + rim, high[1], high[2]), color, {})
        _draw_box(raster, palette, (high[0] - rim, low[1], low[2]), high, color, {})
    else:
        _draw_box(raster, palette, low, (high[0], low[1] + rim, high[2]), color, {})
        _draw_box(raster, palette, (low[0], high[1] - rim, low[2]), high, color, {})


def _block(solid: Solid) -> Block:
    (x, y, z), (sx, sy, sz) = solid.center, solid.size
    return Block(x - sx / 2, y - sy / 2, x + sx / 2, y + sy / 2, z + sz / 2, solid.yaw)


def _lay_patterns(raster: Raster, palette: Palette, colors: Colors) -> None:
    """Draws the patterns of floors and walls where these are visible, into `colors`, which is changed in place."""
    view = raster.view
    right, away, up, flat = view.axes
    kinds = np.take(palette.patterns(), raster.ids).ravel()
    filled = np.flatnonzero(kinds)
    kinds = kinds[filled]
    depth, flat_colors, width = raster.depth.ravel(), colors.reshape(-1, 3), np.int32(raster.ids.shape[1])
    scale = np.float32(view.scale)
    for number, (name, axis, share) in enumerate(palette.patterned, 1):
        cells = filled[kinds == number]
        place = cells.astype(np.int32)
        row = place // width
        u = ((place - row * width).astype(np.float32) + np.float32(0.5 - view.offset[0])) / scale
        v = (np.float32(view.offset[1] - 0.5) - row.astype(np.float32)) / scale
        if axis == "z":
            w = v / np.float32(up)
            flat_colors[cells] = sample(name, u * right[0] + w * away[0], u * right[1] + w * away[1])
            continue
        near = depth[cells] / scale
        w, z = v * up - near * flat, v * flat + near * up
        along = u * right[0] + w * away[0] if axis == "x" else u * right[1] + w * away[1]
        flat_colors[cells] = (sample(name, along, z) * np.float32(share)).astype(np.uint8)


def _lit(colors: Colors, raster: Raster, palette: Palette, light: LightMap) -> Colors:
    """Returns the finished picture: light is asked once for a pixel, and for each of its parts where faces meet."""
    step, ids, sunny = _SUPERSAMPLING, raster.ids, palette.sunny()
    kind, deep = ids[::step, ::step], raster.depth[::step, ::step]
    rows, columns = np.arange(0, ids.shape[0], step)[:, None], np.arange(0, ids.shape[1], step)
    away = palette.away()
    reduced = np.asarray(PilImage.fromarray(colors).reduce(step))
    lit = np.empty(reduced.shape, np.uint8)
    for top in range(0, len(lit), _BAND_ROWS):
        band = slice(top, top + _BAND_ROWS)
        places = _metres(raster.view, deep[band], rows[band], columns)
        lit[band] = _rounded(reduced[band] * _light(raster.view, light, *places, kind[band], sunny, away)[..., None])
    mixed = np.flatnonzero(_mixed(ids))
    down_px, right_px = mixed // kind.shape[1], mixed % kind.shape[1]
    total = np.zeros((len(mixed), 3), np.float32)
    every, flat_ids, depths = colors.reshape(-1, 3), ids.ravel(), raster.depth.ravel()
    for down in range(step):
        for right in range(step):
            below, beside = down_px * step + down, right_px * step + right
            own = below * ids.shape[1] + beside
            places = _metres(raster.view, depths[own], below, beside)
            total += every[own] * _light(raster.view, light, *places, flat_ids[own], sunny, away)[:, None]
    lit.reshape(-1, 3)[mixed] = _rounded(total / np.float32(step * step))
    return lit


def _mixed(ids: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether several faces meet in pixels."""
    step = _SUPERSAMPLING
    first = ids[::step, ::step]
    others = [ids[down::step, right::step] for down in range(step) for right in range(step)]
    mixed = others[1] != first
    for other in others[2:]:
        mixed |= other != first
    return mixed


def _rounded(lit: Image) -> Colors:
    """Returns whole numbers of light."""
    # Half a step is added before the rest is cut off: else a shade of light shows as a line.
    return np.minimum(lit + np.float32(0.5), 255).astype(np.uint8)


def _metres(
    view: View, depth: Image, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> tuple[Image, Image, Image]:
    """Returns depths, places above and places right of the origin of a raster's cells, in metres."""
    scale, (_, _, up, flat) = np.float32(view.scale), view.axes
    above = (np.float32(view.offset[1] - 0.5) - rows.astype(np.float32)) / scale
    right = (columns.astype(np.float32) + np.float32(0.5 - view.offset[0])) / scale
    # Where nothing was drawn one sees the ground.
    return np.where(np.isinf(depth), -above * np.float32(flat / up), depth / scale), above, right


def _light(
    view: View, light: LightMap, depth: Image, v: Image, u: Image, ids: NDArray[np.int32], sunny: Image,
    away: tuple[Image, Image],
) -> Image:  # fmt: skip
    """Returns the brightness of places in a picture, from their depths and places in metres and their colours.

    Light is looked up as far from a place as `away` says for its colour.
    """
    right, far, up, flat = view.axes
    w, z = v * up - depth * flat, v * flat + depth * up
    x, y = u * right[0] + w * far[0], u * right[1] + w * far[1]
    return light.brightness(x + np.take(away[0], ids), y + np.take(away[1], ids), z, np.take(sunny, ids))


def _draw_outlines(raster: Raster, lit: Colors) -> None:
    """Darkens the edges of nearer surfaces and of cut walls in a finished picture, which is changed in place."""
    depth, width = np.maximum(raster.depth, np.float32(-1e6)).ravel(), raster.ids.shape[1]
    limit = np.float32(_EDGE_M * raster.view.scale)
    ids, lines = raster.ids.ravel(), np.zeros(raster.ids.shape, np.uint8)
    marked = lines.reshape(-1)
    for step in (1, width):
        # Depth jumps only where one face ends and another begins.
        cells = np.flatnonzero(ids[step:] != ids[:-step])
        rise = depth[cells + step] - depth[cells]
        marked[cells[rise > limit] + step] = _LINE
        marked[cells[rise < -limit]] = _LINE
        cut = cells[(ids[cells] == CUT) | (ids[cells + step] == CUT)]
        marked[cut] = marked[cut + step] = _CUT_LINE
    # Parts of pixels are not in line: their lines are dotted if they are not evened out.
    even = PilImage.fromarray(lines).filter(ImageFilter.BoxBlur(1)).reduce(_SUPERSAMPLING)
    loss = np.asarray(even).ravel()
    dark, colors = np.flatnonzero(loss), lit.reshape(-1, 3)
    colors[dark] = (colors[dark] * (1 - loss[dark, None] * np.float32(1 / 255))).astype(np.uint8)


def _veil(raster: Raster, colors: Colors) -> None:
    """Mixes the colour of glass into what is behind panes; `colors` is changed in place."""
    flat_colors, cells = colors.reshape(-1, 3), np.flatnonzero(raster.veil)
    seen = flat_colors[cells]
    flat_colors[cells] = (seen + (_VEIL - seen) * np.float32(_VEIL_SHARE)).astype(np.uint8)
