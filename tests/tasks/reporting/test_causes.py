"""Causes of failures in reports: HTML, Markdown and lines of text, with drawings that are safe."""

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree

import pytest
from helpers.browser import NEEDS_BROWSER, browsing
from helpers.planted_causes import draw, planted

from prefect_robomaker.schemas.reports.causes import (
    AxisEffects,
    CellPlot,
    Effect,
    FailureGroup,
    MarginPlot,
    PlotCell,
    Why,
)
from prefect_robomaker.schemas.reports.report import Report
from prefect_robomaker.tasks.causes.explanation import explain
from prefect_robomaker.tasks.causes.stored import read_why, write_why
from prefect_robomaker.tasks.reporting import markdown_report, render_report, summarize, write_report
from prefect_robomaker.tasks.reporting.causes import view_why, why_in_lines
from prefect_robomaker.tasks.reporting.drawings.causes import draw_cells, draw_margins

START = datetime(2026, 3, 2, 9, 30, tzinfo=UTC)
EVIL = "<script>`|"


def report(why: Why | None) -> Report:
    return Report(name="why", run_id="why-1", state="failed", started_at=START, ended_at=START + timedelta(seconds=9),
                  steps=[], worlds=[], jobs=[], command="robomaker run why.yaml", why=why)  # fmt: skip


def made(name: str = "carpet") -> Why:
    [entry] = [each for each in planted("causes") if each["id"] == name]
    why = explain(draw(entry, 1).table)
    assert why is not None
    return why


def test_all_reports_tell_the_same_cause_and_how_to_see_it() -> None:
    why = made()
    page, [first, *_] = render_report(report(why)), why_in_lines(why)
    markdown = markdown_report(summarize(report(why)))
    for text in (page, first, markdown):
        assert "FLOOR = carpet" in text
        assert "38 of 186, elsewhere 8 of 367: 9.5 times as often (95 %: 3.5 to 25.9), in such worlds" in text
        assert "robomaker repro sim-0 --trial 49" in re.sub(r"<span class=\"whole\">(--trial 49)</span>", r"\1", text)
    effects = [AxisEffects(axis="FLOOR", effects=[Effect(on="", claim="to-bed: FLOOR = carpet")])]
    page = render_report(report(why).model_copy(update={"effects": effects}))
    assert page.count("9.5 times as often") == 2, "the sentence, and the table of groups"
    assert '<span class="whole">--trial 49</span>' in page, "no line breaks inside of --trial"
    assert '<span class="sub">trial 49</span>' in page, "no line begins with a comma"
    assert first.startswith("to-bed: 46 trials missed it first; FLOOR = carpet: 38 of 186")


def test_rows_of_tests_that_look_alike_are_one() -> None:
    why = made()
    weaker = why.lifts[0].model_copy(update={"axes": ["FLOOR", "other"], "p_value": 1.0, "lift": 1.0})
    view = view_why(why.model_copy(update={"lifts": [weaker, *why.lifts]}))
    assert view is not None
    told = [(each.group, each.region) for each in view.lifts]
    assert len(told) == len(set(told))
    assert weaker not in view.lifts


def test_one_failure_or_none_has_no_section() -> None:
    alone = Why(trials=3, failed=1, groups=[FailureGroup(requirement="polite", failed=1, job="sim", command="x")])
    for why in (None, alone):
        assert 'id="why"' not in render_report(report(why))
        assert list(why_in_lines(why)) == []
        assert "goes with" not in markdown_report(summarize(report(why)))


def test_what_users_name_is_text() -> None:
    group = FailureGroup(requirement=EVIL, room=EVIL, failed=5, job=EVIL, command=EVIL, refused=EVIL)
    cells = [
        PlotCell(part=EVIL, other_part=other, failed=1, trials=2, rate=0.5, low=0.1, high=0.9) for other in ("", EVIL)
    ]
    plots = [
        CellPlot(group=EVIL, axes=[EVIL], cells=cells[:1]),
        CellPlot(group=EVIL, axes=[EVIL, EVIL], cells=cells[1:]),
    ]
    margins = MarginPlot(requirement=EVIL, axis=EVIL, unit=EVIL, points=[(0.0, 1.0)], parts=[(0.0, 0.0, 1.0, 1.0, 1.0)])
    why = Why(trials=9, failed=5, groups=[group], refused=[EVIL], cell_plots=plots, margin_plots=[margins])
    assert EVIL not in render_report(report(why))
    for drawing in (*map(draw_cells, plots), draw_margins(margins)):
        ElementTree.fromstring(str(drawing))


def test_what_is_stored_is_read_again_and_removed_with_its_failures(tmp_path: Path) -> None:
    why = made()
    write_why(why, tmp_path)
    assert read_why(tmp_path) == why
    write_why(None, tmp_path)
    assert read_why(tmp_path) is None
    (tmp_path / "why.json").write_text("{}")
    assert read_why(tmp_path) is None


@NEEDS_BROWSER
@pytest.mark.deep
@pytest.mark.parametrize("name", ["carpet", "noise-and-latency"])
def test_drawings_fit_a_phone_and_a_desk(name: str, tmp_path: Path) -> None:
    page = write_report(report(made(name)), tmp_path / "report.html")
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        for width in (400, 1280):
            tab.load(page.as_uri(), width)
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
            small = (
                "[...document.querySelectorAll('.cause-plot text')].filter("
                "each => each.getBoundingClientRect().height < 9).length"
            )
            assert tab.evaluate(small) == 0
            outside = (
                "[...document.querySelectorAll('.cause-plot')].filter(plot => [...plot.querySelectorAll('text')].some("
                "each => each.getBoundingClientRect().right > plot.getBoundingClientRect().right + 2)).length"
            )
            assert tab.evaluate(outside) == 0
        assert tab.complaints == []
    assert view_why(made(name)) is not None
