"""Records that a run writes of itself along its simulated time."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.requirements import parse_requirements
from prefect_robomaker.tasks.runtime.episode.run_timeline import TIMELINE_FILE, RunTimeline, read_timeline
from prefect_robomaker.tasks.runtime.process.timeline_recorder import BoundedSeries, TimelineRecorder

LEAST_MARGIN_M = 0.2


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans()), min_size=1, max_size=200))
def test_a_series_stays_short_and_keeps_its_ends_and_marked_samples(steps: list[tuple[int, bool]]) -> None:
    series = BoundedSeries[int](most=12)
    kept = [(float(time), value) for time, (value, keep) in enumerate(steps) if keep][:4]
    for time, (value, _) in enumerate(steps):
        series.add(float(time), value, keep=(float(time), value) in kept)
    found = series.samples()
    assert len(found) <= 12 + len(kept)
    assert set(kept) <= set(found)
    assert found == sorted(found)
    assert found[0] == (0.0, steps[0][0])
    assert found[-1][1] == steps[-1][0], "it ends with the last value"


def test_a_long_series_loses_every_second_sample_but_none_that_is_marked() -> None:
    series = BoundedSeries[int](most=12)
    for time in range(500):
        series.add(float(time), time, keep=time in (2, 3, 301))
    found = series.samples()
    assert len(found) <= 15
    assert {(0.0, 0), (2.0, 2), (3.0, 3), (301.0, 301), (499.0, 499)} <= set(found)


class Judging:
    """An observer that judges a clearance by distances that a test gives, and one that knows nothing before the end."""

    def __init__(self) -> None:
        asked = [
            {"kind": "clearance", "name": "apart", "min_m": LEAST_MARGIN_M},
            {"kind": "time_limit", "name": "quick", "limit_s": 2.0},
        ]
        self.rules: list[Any] = [each.rule(each) for each in parse_requirements(asked, "test")]
        self.rules.append(SimpleNamespace(asked=SimpleNamespace(name="odd"), violated_s=None))  # no margin_until
        self.judged: list[Any] = []
        self.time_s = 0.0

    def look(self, time_s: float, distance_m: float) -> None:
        self.time_s = time_s
        self.rules[0].update(time_s, distance_m, "chair")

    def end(self, time_s: float) -> None:
        self.time_s = time_s
        self.judged = [rule.judged(time_s, "environment") for rule in self.rules[:2]]


def drive(folder: Path) -> tuple[Judging, RunTimeline]:
    """Drives for 1.05 s, nearer and nearer; a log grows at 0.5 s."""
    logs = folder / "logs"
    logs.mkdir()
    (logs / "stdout.log").write_text("begins\n")
    judging = Judging()
    recorder = TimelineRecorder(folder, judging)  # type: ignore[arg-type] # all that it asks for
    for step in range(22):
        time_s = step / 20
        judging.look(time_s, 1.0 - time_s)
        if step == 10:
            (logs / "stdout.log").write_text("begins\nturns\n")
        if time_s >= recorder.next_time_s - 1e-6:
            recorder.watch(None, time_s)
    judging.end(1.05)
    recorder.close("environment")
    return judging, read_timeline((folder / TIMELINE_FILE).read_bytes())


def test_margins_are_those_so_far_and_end_with_those_of_the_result(tmp_path: Path) -> None:
    judging, timeline = drive(tmp_path)
    margins = {each.requirement: each for each in timeline.margins}
    assert list(margins) == ["apart", "quick"], "what has no margin before the end fails no run"
    for judged in judging.judged:
        series = margins[judged.name]
        assert (series.samples[-1][1], series.unit) == (judged.margin, judged.unit)
    apart = dict(margins["apart"].samples)
    assert apart[0.5] == round(0.5 - LEAST_MARGIN_M, 6)
    missed_s = min(time_s for time_s, margin in apart.items() if margin < 0)
    assert 0 <= missed_s - judging.judged[0].first_violation_s <= 0.1


def test_a_log_is_as_long_as_it_was_at_each_time(tmp_path: Path) -> None:
    _, timeline = drive(tmp_path)
    assert [(each.name, each.samples) for each in timeline.logs] == [("logs/stdout.log", [(0.0, 7), (0.5, 13)])]


def test_a_run_that_failed_has_a_timeline_too(tmp_path: Path) -> None:
    recorder = TimelineRecorder(tmp_path, Judging())  # type: ignore[arg-type] # all that it asks for
    recorder.watch(None, 0.0)
    recorder.close(None)
    assert [each.requirement for each in read_timeline((tmp_path / TIMELINE_FILE).read_bytes()).margins] == ["quick"]
