"""Density of furniture: shares of the floor that it covers in sparse, moderate and dense rooms, and the most pieces."""

from ....schemas.worlds.world import RoomType
from ..furniture.usual_furniture import Density

_SHARES: dict[RoomType, tuple[float, float, float]] = {
    "Balcony": (0.12, 0.18, 8.0),
    "Bathroom": (0.19, 0.30, 14.0),
    "Bedroom": (0.20, 0.34, 30.0),
    "Closet": (0.20, 0.27, 12.0),
    "Dining": (0.20, 0.30, 16.0),
    "Hallway": (0.16, 0.23, 10.0),
    "Kitchen": (0.20, 0.29, 14.0),
    "Living": (0.20, 0.31, 24.0),
    "Office": (0.18, 0.28, 14.0),
    "Storage": (0.20, 0.29, 12.0),
}
"""Share of the floor under furniture in moderate and dense rooms, and the floor area up to which it applies (m2).

The shares leave place for people and robots to pass. Larger rooms are emptier, as the cube root of their area.
"""

COVERAGE_CAP: dict[Density, float] = {"Sparse": 0.22, "Moderate": 0.34, "Dense": 0.5}
"""Share of the floor under furniture above which only missing kinds are added, by density."""

MOST_PIECES: dict[Density, int] = {"Sparse": 10, "Moderate": 16, "Dense": 26}
"""Limit of the pieces in a room of up to 40 m2, by density; larger rooms have more, by the power 2/3 of their area."""


def wished_share(room_type: RoomType, density: Density, floor_m2: float) -> float:
    """Returns the share of the floor that furniture of a room should cover."""
    moderate, dense, full_m2 = _SHARES[room_type]
    share = {"Sparse": 0.0, "Moderate": moderate, "Dense": dense}[density]
    return share * min(1.0, (full_m2 / floor_m2) ** (1 / 3))
