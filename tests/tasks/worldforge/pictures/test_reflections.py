"""Mirrors show what stands before them, and nothing of what is behind them."""

import mujoco
import numpy as np

from prefect_robomaker.tasks.worldforge.pictures.ray_casting import Camera, Hits
from prefect_robomaker.tasks.worldforge.pictures.ray_light import Lighting
from prefect_robomaker.tasks.worldforge.pictures.ray_picture import RayPicture

# The camera looks north at a mirror; a red ball is behind the camera, a blue one behind the mirror.
ROOM = """<mujoco><worldbody>
  <geom name="mirror" type="box" pos="0 2 1" size="0.8 0.01 0.6"/>
  <geom name="ball" type="sphere" pos="0.5 -2 1" size="0.4"/>
  <geom name="hidden" type="sphere" pos="-0.5 3.5 1" size="0.4"/>
</worldbody></mujoco>"""
COLORS = np.array([(0.8, 0.8, 0.8), (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)])


def picture(share: float) -> np.ndarray:
    """The mirror as the camera sees it, if it mirrors so much of the light."""

    def look(hits: Hits) -> np.ndarray:
        return COLORS[np.maximum(hits.geoms, 0)]

    drawn = RayPicture(mujoco.MjModel.from_xml_string(ROOM), look)  # pyright: ignore[reportAttributeAccessIssue]
    gloss = np.array([(share, share), (0.0, 0.0), (0.0, 0.0)])
    camera = Camera((0.0, 0.0, 1.0), np.pi / 2, 0.0, 40.0)
    return drawn.draw(camera, Lighting([], ambient=(1.0, 1.0, 1.0), gloss=gloss), 96, 60).astype(float)


def test_a_mirror_shows_what_is_before_it_where_one_would_see_it() -> None:
    red, _, blue = np.moveaxis(picture(1.0), -1, 0)
    reddish = red > blue + 60
    assert reddish.sum() > 40
    # What is east of the camera is on the right in the mirror: 0.5 m aside, 6 m away.
    columns = np.flatnonzero(reddish.any(axis=0))
    middle = (columns[0] + columns[-1]) / 2
    assert abs(middle - (48 + 0.5 / 6 * 48 / np.tan(np.radians(20)))) < 3
    assert not (blue > red + 60).any()


def test_what_does_not_mirror_shows_its_own_color() -> None:
    red, _, blue = np.moveaxis(picture(0.0), -1, 0)
    assert not (np.abs(red - blue)[20:40, 30:66] > 60).any()
