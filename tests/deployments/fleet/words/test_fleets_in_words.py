"""Fleets in words: tables of 80 columns, lines of what changes, the block on a terminal."""

import io
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import pytest
from helpers.simulated_rollouts import BEGAN_S, arn_of, simulate
from rich.cells import cell_len
from rich.console import Console

from prefect_robomaker.deployments.fleet.fleets_in_words import (
    HEARTBEAT_S,
    MOST_LINES,
    MOST_ROBOTS,
    LineWatcher,
    changes,
    print_fleets,
)
from prefect_robomaker.deployments.fleet.live_fleets import fleet_watcher, render
from prefect_robomaker.schemas.fleet.documents import DeploymentJobDocument
from prefect_robomaker.schemas.fleet.operations.deployment_jobs import MaintenanceWindow
from prefect_robomaker.schemas.fleet.rollouts.rollout import Paused, Resumed, Rollback, Rollout
from prefect_robomaker.schemas.fleet.rollouts.standings import FleetStanding, OrderStanding, RobotStanding
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.fleet.rollout.waves import waves_of
from prefect_robomaker.tasks.fleet.views.fleet_standings import Look, deployment_standing

NOW = datetime.fromtimestamp(BEGAN_S, UTC)
LONG = "courier-of-the-third-floor-" + "x" * 90


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def job_of(rollout: Rollout | None, status: str = "Pending") -> Resource:
    arn = "arn:aws:robomaker:us-east-1:123456789012:robot-application/courier/1"
    document = DeploymentJobDocument(
        deployment_application_configs=[{"application": arn, "applicationVersion": "2", "launchConfig": {}}],
        deployment_config={},
        failure_code=rollout.failure_code if rollout else None,
        failure_reason=rollout.failure_reason if rollout else None,
    )
    return Resource(
        arn="arn:aws:robomaker:us-east-1:123456789012:deployment-job/deployment-ab12",
        kind="deployment-job",
        id="deployment-ab12",
        name="deployment-ab12",
        status=rollout.status if rollout else status,
        parent="arn:aws:robomaker:us-east-1:123456789012:deployment-fleet/yard/1",
        created_at=NOW,
        updated_at=NOW,
        revision=1,
        tags={},
        labels={},
        document=document.to_json(),
    )


def look_at(rollout: Rollout | None, at_s: float = 0.0) -> Look:
    waves = () if rollout is None else waves_of(rollout.plan)
    return Look(job_of(rollout), BEGAN_S + at_s, rollout, waves)


def looks(names: list[str], until: Sequence[float], **members: object) -> list[Look]:
    return [look_at(simulate(names, until_s=until_s, **members), until_s) for until_s in until]  # type: ignore[arg-type]


def fleet(*robots: RobotStanding, rollout: Rollout | None = None) -> FleetStanding:
    deployment = None if rollout is None else deployment_standing(job_of(rollout), rollout, BEGAN_S)
    return FleetStanding(fleet="yard", arn="arn", robots=robots, deployment=deployment)


def text_of(standing: FleetStanding) -> str:
    stream = io.StringIO()
    print_fleets([standing], stream, everything=True, now=NOW)
    return stream.getvalue()


def drawn(look: Look) -> str:
    console = Console(file=io.StringIO(), width=1000, record=True)
    console.print(render(look))
    return console.export_text()


def shown(standing: FleetStanding, stream: io.StringIO, *, everything: bool = False) -> list[str]:
    print_fleets([standing, standing], stream, everything=everything, now=NOW)
    return stream.getvalue().splitlines()


def test_a_status_fits_into_80_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")
    order = OrderStanding(number=71234, state="fetched", step="DownloadingExtracting", percent_done=99.6)
    seen = NOW - timedelta(minutes=59)
    robots = (
        RobotStanding(robot=LONG, kind="updater", status="PendingNewDeployment", version="courier 12", last_seen=seen),
        RobotStanding(robot="größer-ロボット", kind="agent", status="Deploying", version=LONG, order=order),
        RobotStanding(robot="r2", status="Failed", failure_code="RobotDeploymentNoResponse", failure_reason="x" * 300),
    )

    printed = shown(fleet(*robots, rollout=simulate(["r0", "r1"], until_s=20)), Terminal())

    lines = [re.sub(r"\x1b\[[0-9;]*m", "", line) for line in printed]
    whole = "\n".join(lines)
    assert max(map(cell_len, lines)) <= 80
    for word in ("PendingNewDeployment", "59 min", "agent", "RobotDeploymentNoResponse", "never", "not enrolled"):
        assert word in whole
    assert any("#71234 Downloading" in line and "100 %" in line for line in lines)


def test_nothing_is_cut_for_other_programs() -> None:
    lines = shown(fleet(RobotStanding(robot=LONG, status="InSync", version="courier 2")), io.StringIO())

    assert lines[:4] == [
        "yard: 1 robot",
        "no deployment yet",
        f"{'robot':<{len(LONG)}}  status  version    seen",
        f"{LONG}  InSync  courier 2  not enrolled",
    ]


def test_of_a_large_fleet_those_that_need_a_look_are_shown() -> None:
    fine = [RobotStanding(robot=f"r{number}", status="InSync") for number in range(500)]
    order = OrderStanding(number=1, state="offered")
    robots = [*fine, RobotStanding(robot="bad", status="Failed"), RobotStanding(robot="busy", status="X", order=order)]

    lines = shown(fleet(*robots), io.StringIO())

    assert [line.split()[0] for line in lines[3:5]] == ["bad", "busy"]
    assert f"… and {502 - MOST_ROBOTS} more robots: --all shows them" in lines
    assert len(shown(fleet(*robots), io.StringIO(), everything=True)) > 1000


def test_each_change_is_a_line() -> None:
    names = ["r0", "r1"]
    before: Look | None = look_at(None)
    lines = changes(None, look_at(None))
    assert lines == ["courier 2 to yard: deployment-ab12", "Pending"]

    found: list[str] = []
    for look in looks(names, range(1, 200, 2), concurrent=50, bad=lambda number: number == 1, threshold=100):
        found += changes(before, look)
        before = look
        if look.has_ended:
            break

    assert found[0] == "InProgress, 2 robots in 2 waves"
    r0 = [line for line in found if line.startswith("r0")]
    assert r0[0].startswith("r0 (wave 1): order 1") or "DownloadingExtracting" in r0[0] or "Validating" in r0[0]
    assert r0[-1] == "r0 (wave 1): InSync"
    assert [line for line in found if line.startswith("r1")][-1].startswith(
        "r1 (wave 2): Failed: PostLaunchFileFailure"
    )
    assert len(found) == len(set(found)), "nothing twice"
    assert found[-2:] == ["1 succeeded, 1 failed; 50 % failed, threshold 100 %", "Succeeded"]


def test_a_failed_deployment_says_why_at_the_end() -> None:
    rollout = simulate([f"r{number}" for number in range(5)], bad=lambda _: True)
    lines = changes(None, look_at(rollout))

    assert lines[-1] == f"Failed: FailureThresholdBreached: {rollout.failure_reason}"


def test_many_changes_at_once_are_one_line() -> None:
    names = [f"r{number}" for number in range(MOST_LINES * 10)]
    first, second = looks(names, (0, 10))

    (line,) = changes(first, second)

    assert line.endswith("deploying, 160 waiting; 0 % failed, threshold 20 %")


def test_pauses_are_told() -> None:
    names = ["r0", "r1"]
    happen = ((3.0, Paused()), (6.0, Resumed()))
    one, two, three = (look_at(simulate(names, concurrent=50, until_s=until_s, events=happen)) for until_s in (2, 4, 7))

    said = f"paused; `robomaker fleet resume {one.job.arn}` lets it go on"
    assert said in changes(one, two)
    assert changes(two, two) == []
    assert "resumed" in changes(two, three)
    assert said in text_of(fleet(rollout=two.rollout))
    assert said in drawn(two)


def test_a_maintenance_window_is_waited_for() -> None:
    opens = NOW + timedelta(minutes=5)
    window = MaintenanceWindow(startTime=opens.strftime("%H:%M"), durationInSeconds=3600)
    closed, still, opened = (
        look_at(simulate(["r0"], until_s=until_s, windows=(window,)), until_s) for until_s in (5, 60, 310)
    )

    [waits] = [line for line in changes(None, closed) if "window" in line]
    assert (
        waits
        == f"waits for its maintenance window, which opens at {opens.replace(second=0).isoformat(timespec='minutes')}"
    )
    assert changes(closed, still) == []
    assert "its maintenance window is open" in changes(still, opened)
    assert waits in text_of(fleet(rollout=closed.rollout))
    assert waits in drawn(closed)


def test_who_goes_back_is_told() -> None:
    jobs = ("arn:aws:robomaker:us-east-1:123456789012:deployment-job/deployment-back",)
    breached = simulate(["r0", "r1"], bad=lambda number: number == 0).model_copy(
        update={"rollback": Rollback(jobs=jobs, left=(arn_of("r1"),), reason="r9 was deleted")}
    )

    for said in (
        text_of(fleet(rollout=breached)),
        drawn(look_at(breached)),
        "\n".join(changes(None, look_at(breached))),
    ):
        assert "robots go back by deployment-back" in said
        assert "no earlier version is known of r1" in said
        assert "robots do not go back: r9 was deleted" in said


def test_a_long_silence_is_broken() -> None:
    now_s = [0.0]
    stream = io.StringIO()
    watch = LineWatcher(stream, clock=lambda: now_s[0])
    look = look_at(simulate(["r0"], until_s=2))
    watch(look)
    said = stream.getvalue()
    now_s[0] = HEARTBEAT_S - 1
    watch(look)
    assert stream.getvalue() == said
    now_s[0] = HEARTBEAT_S
    watch(look)
    assert stream.getvalue().removeprefix(said) == "[       1 min] 1 deploying; 0 % failed, threshold 20 %\n"


@pytest.mark.parametrize("robots", [1, 3, 300])
def test_the_block_fits_into_80_columns(robots: int) -> None:
    names = [f"{LONG}{number}" for number in range(robots)]
    for look in looks(names, (0, 20, 50, 1e9), bad=lambda number: number % 2 == 0, threshold=100):
        console = Console(file=io.StringIO(), width=80, record=True)
        console.print(render(look))
        lines = console.export_text().splitlines()
        assert max(map(len, lines)) <= 80
        assert len(lines) <= 32
        assert lines[0].startswith("yard, for ")
        assert f"/{robots:,}" in "\n".join(lines)


def test_a_terminal_gets_the_block_and_a_pipe_lines() -> None:
    look = look_at(simulate([arn_of("r0").split("/")[1]]))
    pipe, terminal = io.StringIO(), Terminal()
    for stream, environ in ((pipe, {}), (terminal, {})):
        with fleet_watcher(stream, environ) as show:
            show(look)
    silent = Terminal()
    with fleet_watcher(silent, {"CI": "true"}) as show:
        show(look)

    assert "Succeeded\n" in pipe.getvalue()
    assert "\x1b" not in pipe.getvalue()
    assert "\x1b" in terminal.getvalue()
    assert "yard\x1b[0m, for" in terminal.getvalue()
    assert "[       0.0 s] Succeeded" in silent.getvalue()
