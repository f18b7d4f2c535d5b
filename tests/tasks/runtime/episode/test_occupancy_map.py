from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from prefect_robomaker.tasks.runtime.episode.occupancy_map import read_map

YAML = """image: plan.pgm
mode: trinary
resolution: 0.1
origin: [-1.0, 2.0, 0.0]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.196
"""


def write(folder: Path, pixels: list[list[int]], text: str = YAML.format(negate=0)) -> Path:
    Image.fromarray(np.array(pixels, np.uint8)).save(folder / "plan.pgm")
    path = folder / "map.yaml"
    path.write_text(text)
    return path


def test_the_pictures_last_row_is_the_southernmost_and_unknown_is_not_free(tmp_path: Path) -> None:
    known = read_map(write(tmp_path, [[254, 0, 205], [254, 254, 0]]))
    assert known.free.tolist() == [[True, True, False], [True, False, False]]
    assert known.origin == (-1.0, 2.0)


def test_negated_maps_are_read_the_other_way_round(tmp_path: Path) -> None:
    known = read_map(write(tmp_path, [[1, 255]], YAML.format(negate=1)))
    assert known.free.tolist() == [[True, False]]


def test_points_and_cells_belong_together(tmp_path: Path) -> None:
    known = read_map(write(tmp_path, [[254, 254, 254], [254, 254, 254]]))
    rows, columns = known.cells(np.array([[-0.85, 2.05], [-0.95, 2.19]]))
    assert (rows.tolist(), columns.tolist()) == ([0, 1], [1, 0])
    assert known.centers(rows, columns) == pytest.approx(np.array([[-0.85, 2.05], [-0.95, 2.15]]))


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        ("origin: [-1.0, 2.0, 0.0]", "origin: [-1.0, 2.0, 0.5]", "origin: a turned map"),
        ("resolution: 0.1", "resolution: 0", "resolution: 0.0 is not a length"),
        ("free_thresh: 0.196", "", "free_thresh is missing"),
        ("origin: [", "origin: [[", "is no YAML: .*line"),
        ("resolution: 0.1", "resolution: [0.1]", "a member is of another kind"),
        ("origin: [-1.0, 2.0, 0.0]", "origin: 3", "a member is of another kind"),
    ],
)
def test_a_wrong_description_is_named(tmp_path: Path, wrong: str, right: str, message: str) -> None:
    path = write(tmp_path, [[254]], YAML.format(negate=0).replace(wrong, right))
    with pytest.raises(ValueError, match=message):
        read_map(path)
