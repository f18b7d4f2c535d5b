from pathlib import Path

import numpy as np
import pytest
from mcap.reader import NonSeekingReader

from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.cdr import encode, laser_scan
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.recording.state_series import RowSeries


def scan(ranges: np.ndarray, time_s: float = 0.0) -> ros.LaserScan:
    header = ros.Header(ros.Time.from_seconds(time_s), "base_scan")
    return ros.LaserScan(header, -3.1, 3.1, 0.02, 0.0, 0.2, 0.06, 3.5, ranges)


def test_scans_are_those_written_one_by_one_and_in_order_with_other_messages(tmp_path: Path) -> None:
    ranges = np.random.default_rng(0).uniform(0.1, 3.5, (400, 360)).astype(np.float32)
    ranges[0, :5] = np.inf
    series = RowSeries("/scan", laser_scan(scan(ranges[0])))
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        recorder.add_series(series)
        for number, row in enumerate(ranges):  # more than a series holds
            series.add(recorder, number * 0.1, row)
            if number % 3 == 0:
                recorder.write("/clock", ros.Clock(ros.Time.from_seconds(number * 0.1)), number * 0.1)
    with (tmp_path / "r.mcap").open("rb") as stream:
        found = list(NonSeekingReader(stream).iter_messages(log_time_order=False))
    scans = [message.data for _, channel, message in found if channel.topic == "/scan"]
    assert scans == [encode(scan(row, number * 0.1)) for number, row in enumerate(ranges)]
    times = [message.log_time for _, _, message in found]
    assert times == sorted(times)
    assert len(times) == 400 + 134


def test_another_number_of_numbers_is_refused(tmp_path: Path) -> None:
    series = RowSeries("/scan", laser_scan(scan(np.zeros(360, np.float32))))
    with (
        McapRecorder(tmp_path / "r.mcap") as recorder,
        pytest.raises(ValueError, match="/scan has 360 numbers, so 36 are none"),
    ):
        series.add(recorder, 0.0, np.zeros(36, np.float32))
