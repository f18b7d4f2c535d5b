"""A world of our own, exported for Gazebo and imported again, has the same map."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from helpers.paths import REPOSITORY
from scipy import ndimage

from prefect_robomaker.schemas.templates.drawing_notes import DrawingNotes
from prefect_robomaker.tasks.runtime.episode.occupancy_map import OccupancyMap, read_map
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.drawings.drawing_import import Source, import_world
from prefect_robomaker.tasks.worldforge.exports.export import write_export_zip
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world

FLAT = REPOSITORY / "deployments" / "specs" / "plans" / "flat.svg"


def near(one: np.ndarray, of: OccupancyMap, other: np.ndarray, of_other: OccupancyMap) -> float:
    """Share of cells that have one of the other map's within one cell."""
    rows, columns = np.nonzero(one)
    shift = np.round((np.array(of.origin) - of_other.origin) / of.resolution_m).astype(int)
    wide = np.pad(ndimage.binary_dilation(other, np.ones((3, 3), np.bool_)), 40)
    return float(wide[rows + shift[1] + 40, columns + shift[0] + 40].mean())


@pytest.mark.deep
def test_the_map_of_an_exported_world_comes_back(tmp_path: Path) -> None:
    write_bundle(import_world(Source(FLAT), DrawingNotes(), 7), tmp_path / "bundle")
    write_export_zip({"flat": tmp_path / "bundle"}, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        archive.extractall(tmp_path / "export")
    [path] = (tmp_path / "export").rglob("*.world")
    [models] = (tmp_path / "export").rglob("models")
    world = import_gazebo_world(path, Wishes([models], Start(0.0, 0.0)), tmp_path / "again")

    before, after = read_map(path.parent / "map.yaml"), read_map(tmp_path / "again" / "map.yaml")
    assert before.occupied is not None
    assert after.occupied is not None
    for one, other in ((before.free, after.free), (before.occupied, after.occupied)):
        assert near(one, before, other, after) >= 0.99
        assert near(other, after, one, before) >= 0.99
    assert world.checks is not None
    assert world.checks.free_bodies == 15  # five doors, and loose things
