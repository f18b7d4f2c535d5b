"""The page of a deployment in a browser: nothing sticks out, bars are where they belong, on screens of any width."""

from pathlib import Path

import pytest
from helpers.browser import NEEDS_BROWSER, Page, browsing
from helpers.simulated_rollouts import arn_of, report_of, simulate

from prefect_robomaker.schemas.fleet.rollouts.rollout import Paused, Resumed, Rollout, Stopped
from prefect_robomaker.tasks.fleet.reporting.deployment_page import write_deployment

pytestmark = NEEDS_BROWSER

LONG = "courier-with-a-very-long-name-" + "x" * 90


TWELVE = [f"r{number}" for number in range(12)]


def rollouts() -> dict[str, Rollout]:
    return {
        "names": simulate(["r0", LONG, "größer-ロボット"], concurrent=34, threshold=50, bad=lambda number: number == 1),
        "paused": simulate(TWELVE, events=((20, Paused()), (50, Resumed()), (60, Paused())), until_s=90),
        "sixty": simulate([f"r{number}" for number in range(60)], silent=lambda number: number == 3),
        "breach": simulate(TWELVE, bad=lambda number: number > 2),
    }


@pytest.mark.deep
def test_nothing_sticks_out_and_bars_are_where_they_belong(tmp_path: Path) -> None:
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        for name, rollout in rollouts().items():
            nothing_sticks_out(write_deployment(report_of(rollout), tmp_path / f"{name}.html"), tab)
        the_moment_of_the_breach_goes_through_all_rows(tab)
        bars_are_drawn_where_time_and_wave_say(tab, tmp_path)


@pytest.mark.deep
def test_nothing_sticks_out_with_one_robot_or_many_or_before_the_end(tmp_path: Path) -> None:
    more = {
        "one": simulate(["rover"]),
        "running": simulate(TWELVE, until_s=40),
        "canceled": simulate(TWELVE, events=((40, Stopped(why="canceled")),)),
        "large": simulate([f"r{number}" for number in range(600)], bad=lambda number: number % 9 == 2, threshold=50),
    }
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        for name, rollout in more.items():
            nothing_sticks_out(write_deployment(report_of(rollout), tmp_path / f"{name}.html"), tab)


def nothing_sticks_out(page: Path, tab: Page) -> None:
    for width, theme in ((400, "dark"), (1280, "light")):
        tab.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])
        tab.load(page.as_uri(), width)
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
        wide = "[...document.querySelectorAll('.scroll')].filter(each => each.scrollWidth > each.clientWidth).length"
        assert tab.evaluate(wide) == 0
    assert tab.complaints == []


def bars_are_drawn_where_time_and_wave_say(tab: Page, folder: Path) -> None:
    rollout = simulate(["r0", "r1", "r2"], concurrent=34)
    page = write_deployment(report_of(rollout), folder / "bars.html")
    tab.load(page.as_uri(), 1280)

    rows = tab.evaluate(
        "[...document.querySelectorAll('.wave-row')].filter(row => row.querySelector('.launching')).map(row => {"
        "const at = row.querySelector('svg').getBoundingClientRect();"
        "return [row.querySelector('.name').textContent, ...['offered', 'launching'].map(phase => {"
        "const bar = row.querySelector('.' + phase).getBoundingClientRect();"
        "return [(bar.left - at.left) / at.width, (bar.right - at.left) / at.width, bar.height]})]})"
    )

    assert [row[0] for row in rows] == ["r0", "r1", "r2"]
    length_s = max(state.finished_s or 0 for state in rollout.robots.values()) - rollout.began_s
    for name, offered, launching in rows:
        state = rollout.robots[arn_of(name)]
        assert state.offered_s is not None
        assert state.finished_s is not None
        assert offered[0] == pytest.approx((state.offered_s - rollout.began_s) / length_s, abs=0.005)
        assert launching[1] == pytest.approx((state.finished_s - rollout.began_s) / length_s, abs=0.005)
        assert launching[2] > offered[2], "height says the same as colour"


def the_moment_of_the_breach_goes_through_all_rows(tab: Page) -> None:
    rows = "[...document.querySelectorAll('.wave-row svg.row')]"
    marks = f"{rows}.map(row => row.querySelector('use').getBoundingClientRect()).filter(each => each.height > 10)"
    assert tab.evaluate(f"{marks}.length") == tab.evaluate(f"{rows}.length") == 13
    places = set(tab.evaluate(f"{marks}.map(each => Math.round(each.left))"))
    assert len(places) == 1
