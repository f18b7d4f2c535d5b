"""Reader of a world's occupancy map: the YAML file and image that Nav2's map server reads."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

_WHITE = 255.0


@dataclass(frozen=True)
class OccupancyMap:
    """Grid map of a world's free floor cells; rows count northwards, columns eastwards."""

    free: NDArray[np.bool_]
    """Mask of the free cells, shape (rows, columns); unknown cells are not free."""

    resolution_m: float
    """Side length of a cell, in metres."""

    origin: tuple[float, float]
    """Position of the south-west corner of cell `[0, 0]`, in metres."""

    occupied: NDArray[np.bool_] | None = None
    """Mask of the occupied cells, shape (rows, columns); None: the map was read without it."""

    def cells(self, points: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Returns rows and columns of the cells that contain points of shape (n, 2), clipped to the map."""
        rows, columns = self.free.shape
        column, row = ((points - self.origin) / self.resolution_m).astype(np.intp).T
        return np.minimum(np.maximum(row, 0), rows - 1), np.minimum(np.maximum(column, 0), columns - 1)

    def centers(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.float64]:
        """Returns the centres of cells in metres, shape (n, 2)."""
        return np.stack((columns, rows), axis=1) * self.resolution_m + (np.asarray(self.origin) + self.resolution_m / 2)


def read_map(path: Path) -> OccupancyMap:
    """Reads an occupancy map: a `map.yaml` with its image.

    Args:
        path: The YAML file.

    Raises:
        ValueError: The file is no YAML, the map is rotated against the world, or a member is missing or wrong.
    """
    try:
        description = YAML(typ="safe").load(path.read_text())
    except YAMLError as error:
        raise ValueError(f"{path} is no YAML: {' '.join(str(error).split())}") from error
    try:
        return _made_of(path, description)
    except TypeError as error:
        raise ValueError(f"{path}: a member is of another kind than a map server's: {error}") from error


def _made_of(path: Path, description: Any) -> OccupancyMap:
    resolution_m = float(_member(path, description, "resolution"))
    x, y, yaw = (float(value) for value in _member(path, description, "origin"))
    if yaw:
        raise ValueError(f"{path}: origin: a turned map (yaw {yaw}) is not supported; yaw has to be 0")
    if resolution_m <= 0:
        raise ValueError(f"{path}: resolution: {resolution_m} is not a length; it has to be metres per cell, above 0")
    with Image.open(path.parent / _member(path, description, "image")) as picture:
        shade = np.asarray(picture.convert("L"), dtype=np.float64) / _WHITE
    occupancy = shade if description.get("negate", 0) else 1.0 - shade
    # The picture's first row is the northernmost.
    northwards = np.flipud(occupancy)
    free = northwards < float(_member(path, description, "free_thresh"))
    occupied_from = description.get("occupied_thresh")
    occupied = northwards > float(occupied_from) if occupied_from is not None else None
    return OccupancyMap(free, resolution_m, (x, y), occupied)


@lru_cache(maxsize=1)
def read_world_map(world_dir: Path) -> OccupancyMap:
    """Reads the occupancy map of a world, cached.

    Raises:
        ValueError: The map is no YAML, rotated against the world, or lacks a member or has a wrong one.
    """
    return read_map(world_dir / "map.yaml")


def _member(path: Path, description: Any, name: str) -> Any:
    if not isinstance(description, dict) or name not in description:
        raise ValueError(f"{path}: {name} is missing; a map server's description has to have it")
    return description[name]
