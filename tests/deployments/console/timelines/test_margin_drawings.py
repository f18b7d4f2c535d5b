"""Drawings of margins along a run's simulated time."""

from prefect_robomaker.deployments.console.timelines.margin_drawings import draw_margins
from prefect_robomaker.tasks.runtime.episode.run_timeline import MarginSeries


def test_a_margin_that_is_known_at_the_end_only_has_no_empty_drawing() -> None:
    goal = MarginSeries(requirement="to-bed", unit="s", samples=[(8.1, 11.9)])
    gentle = MarginSeries(requirement="gentle", unit="N", samples=[(0.0, 20.0), (3.7, -72.8)])

    [drawn] = draw_margins([goal, gentle], 8.1)

    assert (drawn.requirement, drawn.least, drawn.last) == ("gentle", -72.8, -72.8)
    assert drawn.drawing.count("margin-missed") == 1
