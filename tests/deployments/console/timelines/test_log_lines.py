"""Lines of a log with the simulated times at which they were there."""

from prefect_robomaker.deployments.console.timelines.log_lines import lines_of
from prefect_robomaker.tasks.runtime.episode.run_timeline import LogSeries

LOG = b"begins\n\x1b[31mturns\x1b[0m\nstops\nafter the end"
SERIES = LogSeries(name="logs/stdout.log", samples=[(0.0, 7), (0.5, 10), (0.7, 29)])


def test_a_line_has_the_time_at_which_all_of_it_was_there() -> None:
    lines = [(each.text, each.time_s) for each in lines_of(LOG, len(LOG), SERIES)]
    assert lines == [("begins", 0.0), ("turns", 0.7), ("stops", 0.7), ("after the end", None)]


def test_the_end_of_a_log_has_the_same_times_as_the_whole() -> None:
    tail = LOG[-24:]
    whole = lines_of(LOG, len(LOG), SERIES)
    assert [each.time_s for each in lines_of(tail, len(LOG), SERIES)][-2:] == [each.time_s for each in whole][-2:]
    assert {each.time_s for each in lines_of(LOG, len(LOG), None)} == {None}
