"""A report in a real browser: it is drawn, fits its window, and its tables sort."""

import re
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import NEEDS_BROWSER, Page, browsing
from PIL import Image, ImageStat

from prefect_robomaker.tasks.reporting import write_report

pytestmark = NEEDS_BROWSER


@pytest.mark.deep
def test_a_browser_shows_the_page_and_sorts_its_table(mixed_report: Any, tmp_path: Path) -> None:
    page = write_report(mixed_report, tmp_path / "report.html")
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        for theme, width in (("light", 1200), ("dark", 400)):
            tab.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])
            tab.load(page.as_uri(), width)
            needs_no_scrolling_sideways(tab, width)
            can_be_touched(tab)
            has_light_and_shade(tab.picture(tmp_path / f"{theme}.png"), theme, width)
        sorts_with_gaps_last(tab)
        # Refused styles and scripts, broken references and exceptions.
        assert tab.complaints == []


@pytest.mark.deep
def test_long_names_wrap_and_leave_the_columns_in_the_window(mixed_report: Any, tmp_path: Path) -> None:
    long = "duo in my flat, ROBOMAKER_SIM_TIME_LIMIT_S=20, requirements: soft, policy=turn_away.py:act, seed=7"
    jobs = [job.model_copy(update={"name": f"{long} {number}"}) for number, job in enumerate(mixed_report.jobs)]
    page = write_report(mixed_report.model_copy(update={"jobs": jobs}), tmp_path / "report.html")
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        tab.load(page.as_uri(), 1300)
        needs_no_scrolling_sideways(tab, 1300)


def has_light_and_shade(picture: Path, theme: str, width: int) -> None:
    with Image.open(picture) as opened:
        image = opened.convert("RGB")
    assert image.width == width
    seen = image.crop((0, 0, width, 1000))
    brightness = ImageStat.Stat(seen.convert("L"))
    assert brightness.mean[0] > 180 if theme == "light" else brightness.mean[0] < 70
    assert brightness.stddev[0] > 12
    assert len(seen.resize((width // 2, 500)).getcolors(500_000) or []) > 500


def needs_no_scrolling_sideways(tab: Page, width: int) -> None:
    tables = "[...document.querySelectorAll('.scroll')]"
    wide = f"{tables}.filter(each => each.scrollWidth > each.clientWidth).map(each => each.outerHTML)"
    assert tab.evaluate(wide) == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= width


def can_be_touched(tab: Page) -> None:
    is_flat = "each => (box => box.width > 0 && box.height < 23.9)(each.getBoundingClientRect())"
    flat = f"[...document.querySelectorAll('a, button, summary')].filter({is_flat}).map(each => each.outerHTML)"
    assert tab.evaluate(flat) == [], "WCAG 2.2 asks for targets of 24 pixels"


def sorts_with_gaps_last(tab: Page) -> None:
    tab.evaluate("document.querySelectorAll('.sortable th button')[3].click()")
    table = tab.evaluate("document.querySelector('table.sortable.stacks').outerHTML")
    assert re.search(r'aria-sort="ascending"><button type="button">Distance', table)
    jobs = re.findall(r'<th scope="row"[^>]*><a [^>]*><span[^>]*>\d+</span> ([^<]+)</a>', table)
    assert jobs == ["sim-fail1", "sim-pass1", "sim-pass2", "sim-broken1", "sim-cancel1"]
