"""The page of a deployment: head, waves, robots, and what was deployed."""

import re
from html import unescape

import pytest
from helpers.simulated_rollouts import BEGAN_S, arn_of, report_of, simulate

from prefect_robomaker.schemas.fleet.operations.deployment_jobs import DeploymentConfig, MaintenanceWindow
from prefect_robomaker.schemas.fleet.rollouts.rollout import Pause, Paused, Resumed, RobotGone, Rollout, Stopped
from prefect_robomaker.tasks.fleet.reporting.deployment_page import render_deployment
from prefect_robomaker.tasks.fleet.reporting.deployment_view import MOST_ROWS, RolloutPage, view_rollout


def names(count: int) -> list[str]:
    return [f"r{number}" for number in range(count)]


def ends(page: RolloutPage) -> dict[str, int]:
    return {end.word: count for end, count in page.counts}


def text_of(rollout: Rollout) -> str:
    page = re.sub(r"<(style|script)>.*?</\1>", "", render_deployment(report_of(rollout)), flags=re.DOTALL)
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", page)))


def test_a_good_rollout() -> None:
    rollout = simulate(names(10), concurrent=40)
    page = view_rollout(report_of(rollout))

    assert (page.state, page.headline) == ("succeeded", "10 of 10 robots in sync")
    assert [[robot.name for robot in wave.robots] for wave in page.waves] == [
        names(10)[:4],
        names(10)[4:8],
        names(10)[8:],
    ]
    assert page.trouble == []
    first, fifth = page.robots[0], page.robots[4]
    assert (first.before, first.after) == ("courier 1", "courier 2")
    assert (fifth.before, fifth.after) == ("", "courier 2")
    state = rollout.robots[arn_of("r0")]
    assert state.finished_s is not None
    assert first.took_s == state.finished_s - (state.offered_s or 0)


def test_a_breach_says_when_and_why_and_shows_robots_not_reached() -> None:
    rollout = simulate(names(20), bad=lambda number: number >= 4, threshold=20)
    page = view_rollout(report_of(rollout))

    assert page.headline == rollout.failure_reason
    assert "failed, which is 20 %; the threshold is 20 %" in page.headline
    assert page.breached_after
    assert ends(page)["not reached"] == sum(state.order == "none" for state in rollout.robots.values()) > 0
    ((code, count, reason),) = page.trouble
    assert (code, count) == ("PostLaunchFileFailure", ends(page)["failed"])
    assert "ロボットアームが応答しません" in reason
    failed = next(robot for robot in page.robots if robot.code)
    assert failed.after == failed.before, "it still has what it had"
    assert 'class="breach"' in page.marks


def test_pauses_cancels_and_departures_are_told() -> None:
    paused = view_rollout(report_of(simulate(names(9), events=((5, Paused()), (65, Resumed())))))
    assert [lasted for _, lasted in paused.pauses] == ["1 min"]
    assert ("paused", "1 min") in paused.numbers

    still = view_rollout(report_of(simulate(names(9), events=((5, Paused()),), until_s=60)))
    assert still.state == "paused"

    waiting = report_of(simulate(names(9), until_s=60)).model_copy(
        update={
            "notes": ("waits for its maintenance window, which opens at 22:30", "robots go back by `deployment-x`"),
            "closed": (Pause(from_s=BEGAN_S + 10, until_s=BEGAN_S + 30),),
            "config": DeploymentConfig(
                maintenanceWindows=[MaintenanceWindow(startTime="22:30", durationInSeconds=7200, days=["MONDAY"])],
                requiresApproval=True,
                canaryPercentage=5,
                onThresholdBreached="ROLLBACK",
            ),
        }
    )
    page = view_rollout(waiting)
    assert page.marks.count('class="closed"') == 1
    assert {fact.name: fact.value for fact in page.facts}.items() >= {
        "Maintenance window": "22:30 UTC, for 2 h, Monday",
        "Approval": "not given",
        "Canaries": "5 %",
        "At the threshold": "robots go back to the version before",
    }.items()
    html = render_deployment(waiting)
    assert "waits for its maintenance window, which opens at 22:30" in html
    assert "robots go back by deployment-x" in html
    assert "no maintenance window" in html

    gone = RobotGone(robot=arn_of("r8"), how="deleted")
    canceled = view_rollout(report_of(simulate(names(9), events=((2, gone), (30, Stopped(why="canceled"))))))
    assert canceled.state == "canceled"
    assert ends(canceled)["deleted"] == 1


def test_a_deployment_that_was_not_prepared_has_a_page() -> None:
    whole = report_of(simulate(names(1)))
    report = whole.model_copy(
        update={"rollout": None, "delivery": None, "waves": (), "status": "Failed", "failure_code": "EtagMismatch"}
    )

    page = render_deployment(report)

    assert "EtagMismatch" in page
    assert '<h2 id="waves-title"' not in page


def test_words_of_others_are_text_and_nothing_is_loaded() -> None:
    page = render_deployment(report_of(simulate(["<img src=x>", "größer-ロボット"])))

    assert "<img src=x>" not in page
    assert "&lt;img src=x&gt;" in page
    assert "Grüß Gott &lt;b&gt;" in page
    assert re.findall(r'(?:src|href)="(?!#|data:,)', page) == []


def test_what_was_deployed_is_told() -> None:
    text = text_of(simulate(names(2)))

    for word in ("courier, version 2", "ab12" * 16, "drive.launch", "health.sh", "10.2 MB", "X86_64", "2 min"):
        assert word in text
    assert "X_TOKEN=(secret)" in text
    assert "hunter2" not in text


@pytest.mark.parametrize("robots", [MOST_ROWS, MOST_ROWS + 1])
def test_a_large_fleet_is_shown_by_waves(robots: int) -> None:
    rollout = simulate(names(robots), bad=lambda number: number % 40 == 7, threshold=100)
    page = view_rollout(report_of(rollout))

    assert page.is_large == (robots > MOST_ROWS)
    assert sum(wave.count for wave in page.waves) == robots
    assert all(sum(count for _, count in wave.ends) == wave.count for wave in page.waves)
    first = page.robots[0]
    assert bool(first.code) == page.is_large, "those that need a look stand first"
    assert ("<rect" in page.waves[0].blocks) == page.is_large


def test_the_same_rollout_gives_the_same_page() -> None:
    rollout = simulate(names(12), bad=lambda number: number == 3)

    assert render_deployment(report_of(rollout)) == render_deployment(report_of(Rollout.of_json(rollout.to_json())))
