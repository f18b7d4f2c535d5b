"""The measurements of a lidar, published a chunk at a time."""

import numpy as np
from numpy.typing import NDArray

from . import messages as ros
from .columns import AnyNumbers, Columns, Numbers, laser_scan
from .recorder import Recorder

_MAX_BYTES = 256 * 1024
"""Limit of the messages that wait for a chunk, in bytes."""


class ScanSeries:
    """Gathers a lidar's measurements for a recorder; messages are made when a chunk is written."""

    def __init__(self, topic: str, scan: ros.LaserScan) -> None:
        """Prepares a series; `Recorder.add_series` takes it.

        Args:
            topic: Where the scans go, `/scan`.
            scan: One of them, for all that does not change; it has no intensities.
        """
        columns = laser_scan(scan)
        self.topics: list[tuple[str, Columns]] = [(topic, columns)]
        self._rays = len(scan.ranges)
        self._capacity = max(1, _MAX_BYTES // len(columns.template))
        self._times: list[float] = []
        self._ranges: list[bytes] = []

    def add(self, recorder: Recorder, time_s: float, ranges: NDArray[np.float32]) -> None:
        """Notes a measurement.

        Args:
            recorder: Who was given the series; it writes what there is when no more fits.
            time_s: Simulated time.
            ranges: Metres, as many as there are rays.

        Raises:
            ValueError: There is another number of ranges.
            RecordingError: The file cannot be written.
        """
        if len(ranges) != self._rays:
            raise ValueError(f"the lidar has {self._rays} rays, so {len(ranges)} ranges are no scan of it")
        self._ranges.append(ranges.astype(np.float32, copy=False).tobytes())
        self._times.append(time_s)
        recorder.flush_when_due(full=len(self._times) >= self._capacity)

    def take(self) -> tuple[Numbers, list[list[AnyNumbers]]]:
        """Returns what was noted since the last time: times, and the ranges, a row per time."""
        times, self._times = self._times, []
        rows, self._ranges = self._ranges, []
        ranges = np.frombuffer(b"".join(rows[: len(times)]), np.float32).reshape(len(times), self._rays)
        return np.array(times), [[ranges]]
