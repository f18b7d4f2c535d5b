"""The catalogue's sheet: every style of a kind in a picture of its own."""

import io

import numpy as np
from PIL import Image

from prefect_robomaker.tasks.worldforge.furniture.catalogue import styles_of
from prefect_robomaker.tasks.worldforge.viewer.catalogue_sheet import (
    CELL_HEIGHT,
    CELL_WIDTH,
    catalogue_sheet,
    style_picture,
)


def test_a_sheet_shows_every_style_of_its_kinds() -> None:
    sheet = np.asarray(Image.open(io.BytesIO(catalogue_sheet(("Showers", "Nightstands")))))
    for row, kind in enumerate(("Showers", "Nightstands")):
        top = row * sheet.shape[0] // 2 + 20
        filled = [
            bool(sheet[top : top + CELL_HEIGHT - 4, left : left + CELL_WIDTH].std() > 8)
            for left in range(0, sheet.shape[1], CELL_WIDTH)
        ]
        assert filled == [number < len(styles_of(kind)) for number in range(len(filled))]


def test_a_piece_fills_its_picture_and_casts_a_shadow() -> None:
    style = next(style for style in styles_of("Sofas") if style.colors == "navy")
    picture = style_picture("Sofas", style).astype(int)
    blue = picture[..., 2] - picture[..., 0] > 25
    rows, columns = np.nonzero(blue)
    assert 0.1 < blue.mean() < 0.6
    assert rows.min() > 3
    assert rows.max() < CELL_HEIGHT - 3
    assert columns.min() > 3
    assert columns.max() < CELL_WIDTH - 3
    floor = picture[~blue].sum(axis=1)
    assert floor.min() < 0.6 * floor.max()
