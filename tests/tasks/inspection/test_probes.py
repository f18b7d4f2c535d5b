"""What a probe took."""

from datetime import UTC, datetime, timedelta

import pytest

from prefect_robomaker.tasks.inspection.probes import time_in_place_s

BEGAN = datetime(2026, 3, 1, tzinfo=UTC)


@pytest.mark.parametrize(
    ("ends_s", "at_once", "expected_s"),
    [
        ([], 2, 0.0),
        ([5.0, 5.0], 2, 0.0),  # none has waited for another
        ([5.0, 5.0, 8.0, 8.0], 2, 3.0),  # the first two waited two seconds for their processes
        ([5.0, 8.0, 11.0], 1, 3.0),
        ([4.0, 5.0, 6.0, 7.0, 8.0, 9.0], 2, 2.0),  # taking turns: one a second
    ],
)
def test_time_in_a_place_is_told_by_the_ends_of_all_but_the_first(
    ends_s: list[float], at_once: int, expected_s: float
) -> None:
    ended = [BEGAN + timedelta(seconds=end_s) for end_s in ends_s]
    assert time_in_place_s(ended, at_once) == pytest.approx(expected_s)
