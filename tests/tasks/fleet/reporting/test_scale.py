"""The time axis."""

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.fleet.reporting.chart import Scale


def test_ticks_are_round_times() -> None:
    assert [text for _, text in Scale(0, 222).ticks()] == ["0", "1 min", "2 min", "3 min"]
    assert [text for _, text in Scale(0, 75).ticks()] == ["0", "15 s", "30 s", "45 s", "1 min", "1 min 15 s"]
    assert [text for _, text in Scale(0, 4 * 86400).ticks()] == ["0", "24 h", "48 h", "72 h", "96 h"]


def test_a_rollout_that_ended_at_once_can_be_drawn() -> None:
    scale = Scale(100, 100)
    assert scale.at(100) == "0%"
    assert scale.width(100, 100) == "0%"


@given(st.floats(0, 1e9), st.floats(0.1, 1e8), st.floats(-1e9, 2e9))
def test_all_moments_are_within_the_chart(from_s: float, length_s: float, at_s: float) -> None:
    scale = Scale(from_s, from_s + length_s)
    assert 0 <= scale.part(at_s) <= 1
    ticks = scale.ticks()
    assert 1 <= len(ticks) <= 7
    assert all(0 <= part <= 1 for part, _ in ticks)
