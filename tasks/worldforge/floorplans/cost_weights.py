"""What faults of a floor plan cost, in both searches: of rectangles, and of L-shaped rooms.

Costs of a plan are summed; a deviation of a ratio is the absolute logarithm of actual over desired, and costs itself.
A fault that makes a plan useless (9.0) outweighs everything that a plan may miss otherwise.
"""

from math import log

TOLERANCE = log(1.15)
"""Deviation of a ratio above which the search counts a preference as missed; a little stricter than the report."""

MISSED_PREFERENCE = 0.3
"""Added to a deviation above the tolerance."""

OUTLIER = 1.5
"""Factor of a deviation's square, so that one bad room costs more than two that are a little off."""

FOOTPRINT_WEIGHTS = (0.0, 0.7, 1.3, 2.0)
"""By number of rooms, the last from there on: with one room, the room's own preference wins."""

TOO_NARROW = 9.0
NOT_CONNECTED = 9.0
MISSED_CONNECTION = 2.5
STRANGE_NEIGHBOURS = 0.8
"""Most that a room between others that it does not belong to costs."""
