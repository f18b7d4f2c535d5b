"""Light at the pixels of pictures: soft shadows below lamps and in sunlight, and shade in corners."""

import mujoco
import numpy as np
import pytest

from prefect_robomaker.tasks.worldforge.pictures.ray_casting import Camera, Hits, RayCaster
from prefect_robomaker.tasks.worldforge.pictures.ray_light import (
    STEP,
    Corners,
    Lamp,
    LightGrid,
    Lighting,
    slots_of,
    soft_light,
)
from prefect_robomaker.tasks.worldforge.pictures.room_lights import Opening, Sun

WIDTH, HEIGHT = 480, 360
BOX_ON_FLOOR = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="9 9 1"/>
  <geom name="box" type="box" pos="0 0 0.25" size="0.25 0.25 0.25"/>
</worldbody></mujoco>"""


def light_of(lighting: Lighting) -> tuple[np.ndarray, np.ndarray]:
    """Light at the grid's pixels with the shade of corners, and their places, seen from above the south."""
    caster = RayCaster(mujoco.MjModel.from_xml_string(BOX_ON_FLOOR))  # pyright: ignore[reportAttributeAccessIssue]
    camera = Camera((0.0, -2.0, 1.5), np.pi / 2, -0.6, 70.0)
    rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:HEIGHT, 0:WIDTH])
    hits = caster.hits(camera.place, camera.rays(WIDTH, HEIGHT, columns, rows))
    grid = LightGrid.cast(caster, hits, lighting, (HEIGHT, WIDTH))
    share = Corners.cast(hits, lighting, (HEIGHT, WIDTH)).share.reshape(HEIGHT, WIDTH)[::STEP, ::STEP]
    return grid.light.mean(axis=1) * share.ravel(), grid.hits.places


def floor_near(places: np.ndarray, low: float, high: float) -> np.ndarray:
    """The floor south of the box, at distances from it."""
    away = -0.25 - places[:, 1]
    return (np.abs(places[:, 2]) < 1e-3) & (np.abs(places[:, 0]) < 0.15) & (away > low) & (away < high)


def test_a_box_takes_light_from_the_floor_before_it_and_not_from_far_away() -> None:
    light, places = light_of(Lighting([], ambient=(1.0, 1.0, 1.0), shaded_m=0.5))
    near, far = light[floor_near(places, 0.0, 0.06)], light[floor_near(places, 0.7, 1.0)]
    assert min(len(near), len(far)) > 3
    assert near.mean() < 0.9 * far.mean()
    assert far.min() > 0.97
    plain, _ = light_of(Lighting([], ambient=(1.0, 1.0, 1.0)))
    assert plain[floor_near(places, 0.0, 1.0)] == pytest.approx(1.0)


def test_the_shade_where_a_box_stands_is_narrow_and_has_no_grain() -> None:
    caster = RayCaster(mujoco.MjModel.from_xml_string(BOX_ON_FLOOR))  # pyright: ignore[reportAttributeAccessIssue]
    camera = Camera((0.0, -2.0, 1.5), np.pi / 2, -0.6, 70.0)
    rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[0:HEIGHT, 0:WIDTH])
    hits = caster.hits(camera.place, camera.rays(WIDTH, HEIGHT, columns, rows))
    corners = Corners.cast(hits, Lighting([], shaded_m=0.5), (HEIGHT, WIDTH))
    foot, near = (floor_near(hits.places, *span) for span in ((0.0, 0.015), (0.12, 0.135)))
    assert corners.share[foot].mean() < corners.share[near].mean() - 0.15
    # Along the box nothing changes.
    assert corners.share[near].std() < 0.02
    # Between pixels, a place has the shade of those of its own surface.
    between = corners.at(hits[foot], rows[foot] + 0.4, columns[foot] - 0.4)
    assert np.abs(between - corners.share[foot]).max() < 0.2


def test_the_shadow_of_a_lamp_that_is_wide_has_a_soft_edge() -> None:
    lamps = [Lamp((0.02 * x, 2.0, 1.2), 4.0) for x in range(-8, 8)]
    light, places = light_of(Lighting([lamps], ambient=(0.0, 0.0, 0.0)))
    behind = floor_near(places, 0.02, 0.12)
    beside = (np.abs(places[:, 2]) < 1e-3) & (np.abs(places[:, 0]) > 0.9) & (np.abs(places[:, 1]) < 0.4)
    assert light[behind].mean() < 0.3 * light[beside].mean()
    edge = (np.abs(places[:, 2]) < 1e-3) & (places[:, 1] < -0.3) & (places[:, 1] > -0.6)
    values = light[edge] / light[beside].mean()
    assert ((values > 0.25) & (values < 0.75)).sum() > 3


SUNLIT = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="9 9 1"/>
  <geom name="edge" type="box" pos="-1 0 {0}" size="1 1 0.01"/>
</worldbody></mujoco>"""


def penumbra_m(height_m: float) -> float:
    """Width of the border between sun and shade on the floor below the edge of a board at a height."""
    caster = RayCaster(mujoco.MjModel.from_xml_string(SUNLIT.format(height_m)))  # pyright: ignore[reportAttributeAccessIssue]
    opening = Opening(np.array((2.0, -4.0, 0.0)), np.array((0.0, 8.0, 0.0)), 9.0, np.array((-1.0, 0.0, 0.0)))
    sun = Sun(caster, [opening])
    rows, columns = 8, 600
    x = np.linspace(-1.5, 1.5, columns)
    places = np.stack(
        [np.tile(x, rows), np.repeat(np.linspace(-0.02, 0.02, rows), columns), np.zeros(rows * columns)], 1
    )
    hits = Hits(np.zeros(len(places), np.int32), places, np.tile((0.0, 0.0, 1.0), (len(places), 1)))
    light = soft_light(hits, sun.light(hits, slots_of((rows, columns))), (rows, columns), np.arange(len(places)))
    share = light[:, 0].reshape(rows, columns)[rows // 2]
    share = share / share.max()
    return float(((share > 0.1) & (share < 0.9)).sum() * (x[1] - x[0]))


def test_the_edge_of_sunlight_is_softer_far_from_what_shades_it() -> None:
    near, far = penumbra_m(0.15), penumbra_m(0.6)
    assert far > 2.5 * near
    assert far < 0.2


def test_a_bar_that_the_grid_misses_has_its_own_light() -> None:
    # Pixels of the grid are three apart: a bar of one pixel between two of them has none.
    width, height = 48, 30
    rows, columns = (axis.ravel() for axis in np.indices((height, width)))
    bar = rows == 16
    places = np.stack([columns * 0.02, np.zeros(len(rows)), rows * 0.02], axis=1)
    normals = np.tile((0.0, -1.0, 0.0), (len(rows), 1))
    places[bar, 1], normals[bar] = -0.5, (0.0, 0.0, 1.0)
    hits = Hits(np.where(bar, 1, 0).astype(np.int32), places, normals)
    caster = RayCaster(mujoco.MjModel.from_xml_string("<mujoco/>"))  # pyright: ignore[reportAttributeAccessIssue]
    # The lamp is above the bar and behind the rest.
    lighting = Lighting([[Lamp((0.48, 0.5, 3.0), 4.0)] * 16], ambient=(0.1, 0.1, 0.1))
    grid = LightGrid.cast(caster, hits, lighting, (height, width))
    at = hits[bar], rows[bar].astype(float), columns[bar].astype(float)
    missed = grid.at(*at)[0].mean(axis=1)
    found = grid.refined(caster, hits, lighting, (height, width)).at(*at)[0].mean(axis=1)
    assert missed.max() < 0.2
    assert found.min() > 0.5
