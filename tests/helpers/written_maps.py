"""Maps of worlds, read back by the reader that applications have, which shares no code with what writes them."""

from pathlib import Path

from prefect_robomaker.tasks.runtime.episode.occupancy_map import read_map
from prefect_robomaker.tasks.worldforge.geometry.occupancy import OccupancyGrid


def read_grid(folder: Path) -> OccupancyGrid:
    """The grid that `map.pgm` and `map.yaml` of a folder hold."""
    read = read_map(folder / "map.yaml")
    assert read.occupied is not None
    return OccupancyGrid(read.origin, read.occupied, read.free | read.occupied, read.resolution_m)
