"""The view from windows: sky above, a garden below, all round without a seam."""

import numpy as np

from prefect_robomaker.tasks.worldforge.pictures.outside import outside


def toward(azimuth: np.ndarray, rise: float) -> np.ndarray:
    return np.stack([np.cos(azimuth), np.sin(azimuth), np.full(len(azimuth), rise)], axis=1)


def test_the_sky_is_blue_and_the_lawn_is_green_all_round() -> None:
    around = np.linspace(-np.pi, np.pi, 200)
    red, green, blue = outside(toward(around, 1.5)).T
    assert np.all(blue >= green)
    assert np.all(green >= red)
    red, green, blue = outside(toward(around, -0.6)).T
    assert np.all(green > np.maximum(red, blue))
    assert outside(np.zeros((0, 3))).shape == (0, 3)


def test_directions_just_beside_each_other_look_alike_where_the_circle_closes() -> None:
    rises = np.linspace(-0.4, 0.5, 90)
    one, other = (np.concatenate([toward(np.array([angle]), rise) for rise in rises]) for angle in (3.14159, -3.14159))
    # Leaves have a seam that nobody sees; outlines of hills, woods and hedges have none.
    assert np.abs(outside(one) - outside(other)).mean() < 0.02
    assert np.abs(outside(one) - outside(toward(np.full(90, 0.5), 0.3))).mean() > 0.05


def test_things_are_told_apart_around_the_horizon() -> None:
    around = np.linspace(-np.pi, np.pi, 400)
    colors = np.concatenate([outside(toward(around, rise)) for rise in np.linspace(-0.1, 0.3, 20)])
    assert len(np.unique((colors * 12).astype(int), axis=0)) > 40


def test_houses_stand_over_the_hedge_before_a_pale_horizon() -> None:
    around = np.linspace(-np.pi, np.pi, 600)
    red, green, blue = outside(toward(around, 0.02)).T
    # Half of what one sees just over the hedge is no leaf: houses and their windows.
    assert np.mean(green <= np.maximum(red, blue)) > 0.3
    low, high = (np.quantile(outside(toward(around, rise)), 0.9, axis=0) for rise in (0.09, 0.6))
    # Haze makes the sky paler towards the horizon, red first.
    assert low[0] - high[0] > 0.08
    assert low.min() > 0.86
