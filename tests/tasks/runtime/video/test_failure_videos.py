"""Runs with a state log, and what is filmed of it when they fail; real processes, real films."""

import json
import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from helpers.paths import BUNDLES
from PIL import Image

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunOutcome, RunPlan
from prefect_robomaker.schemas.runs.programs import RunStop
from prefect_robomaker.tasks.runtime.episode.run_timeline import TIMELINE_FILE, FilmTimes, read_timeline
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.video.failure_videos import has_failed, record_failure_videos

FILMED = BUNDLES / "filmed"
FILMS = {"video.mp4", "last-10s.mp4", "poster.png"}
SMALL = {"ROBOMAKER_VIDEO_SIZE": "160x120", "ROBOMAKER_VIDEO_FPS": "10"}
PlanOf = Callable[..., RunPlan]


@pytest.fixture
def plan_of(make_plan: PlanOf) -> PlanOf:
    """Plans a run of the `filmed` bundle, small and at 10 pictures a second."""

    def plan(video: str = "on-failure", max_duration_s: float = 30.0, **variables: str) -> RunPlan:
        application = ApplicationPlan(
            role="simulation", name="arena", attribute="filmed.arena.make_environment", path=FILMED,
            environment_variables=SMALL | variables,
        )  # fmt: skip
        robot = ApplicationPlan(role="robot", name="driver", attribute="filmed.arena.make_agent", path=FILMED)
        return make_plan(
            simulation_application=application, robot_application=robot, video=video, max_duration_s=max_duration_s
        )

    return plan


def frames(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def ball_row(picture: Any) -> float:
    """Where the ball is, in rows from the top."""
    pixels = np.asarray(picture).astype(int)
    red = (pixels[..., 0] > 100) & (pixels[..., 1] < 80) & (pixels[..., 2] < 80)
    assert red.any(), "the ball is in the picture"
    return float(np.nonzero(red)[0].mean())


def films_in(plan: RunPlan) -> set[str]:
    names = {path.name for path in plan.output_dir.iterdir()}
    assert not {name for name in names if name.endswith(".unfinished")}
    return names & FILMS


def errors_of(plan: RunPlan) -> str:
    return (plan.output_dir / "logs" / "stderr.log").read_text()


@pytest.mark.parametrize(
    ("end", "status", "code"),
    [
        ("kill", "Failed", "SimulationApplicationCrash"),
        pytest.param("fail", "Completed", None, marks=pytest.mark.deep),
        pytest.param("raise", "Failed", "SimulationApplicationCrash", marks=pytest.mark.deep),
    ],
)
def test_a_run_that_fails_is_filmed(
    launcher: Launcher, plan_of: PlanOf, tmp_path: Path, end: str, status: str, code: str
) -> None:
    plan = plan_of(END=end)
    plan.output_dir.mkdir(parents=True)
    for name in FILMS:  # links that programs have left are not followed
        (plan.output_dir / name).symlink_to(tmp_path / f"mine-{name}")
    outcome = launcher.run(plan, lambda: None)
    assert (outcome.status, outcome.failure_code) == (status, code)
    assert films_in(plan) == FILMS
    assert list(tmp_path.glob("mine-*")) == []
    film = frames(plan.output_dir / "video.mp4")
    assert len(film) in (10, 11)  # the step in which it crashes is not seen any more
    assert film[0].shape == (120, 160, 3)
    assert ball_row(film[-1]) - ball_row(film[0]) > 20, "the ball falls"
    with Image.open(plan.output_dir / "poster.png") as poster:
        assert abs(ball_row(poster) - ball_row(film[-1])) < 2, "the poster is the last moment"


def test_a_run_that_passes_is_not(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of(END="pass")
    assert launcher.run(plan, lambda: None).status == "Completed"
    assert films_in(plan) == set()
    assert json.loads((plan.output_dir / "result.json").read_text())["extra"] == {}


def test_a_run_without_the_policy_keeps_no_log(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of(video="none", END="raise")
    assert launcher.run(plan, lambda: None).status == "Failed"
    assert films_in(plan) == set()
    assert not (plan.work_dir / "state-log").exists()


def test_the_clip_has_the_last_ten_seconds(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of(END="fail", END_S="12", ROBOMAKER_VIDEO_FPS="4")
    launcher.run(plan, lambda: None)
    film, clip = frames(plan.output_dir / "video.mp4"), frames(plan.output_dir / "last-10s.mp4")
    assert (len(film), len(clip)) == (49, 41)
    assert np.abs(film[8].astype(int) - clip[0]).mean() < 4
    assert ball_row(film[0]) < ball_row(clip[0]) - 20
    times = read_timeline((plan.output_dir / TIMELINE_FILE).read_bytes()).videos
    assert times["video.mp4"] == FilmTimes(begins_s=0.0, rate_hz=4, frames=len(film))
    assert times["last-10s.mp4"] == FilmTimes(begins_s=2.0, rate_hz=4, frames=len(clip))


@pytest.mark.deep
def test_a_run_that_runs_out_of_time_is_filmed(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of(END="hang", max_duration_s=1.5)
    outcome = launcher.run(plan, lambda: None)
    assert outcome.timed_out
    assert films_in(plan) == FILMS
    assert len(frames(plan.output_dir / "video.mp4")) == 10


def test_a_canceled_run_is_not_filmed(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of(END="hang")
    states = plan.work_dir / "state-log" / "states.tail"
    outcome = launcher.run(plan, lambda: RunStop.CANCELED if states.exists() else None)
    assert outcome.status == "Canceled"
    assert films_in(plan) == set()


@pytest.mark.deep
@pytest.mark.parametrize("end", ["fail", "kill"])
def test_with_always_a_failed_run_has_all_films_too(launcher: Launcher, plan_of: PlanOf, end: str) -> None:
    plan = plan_of(video="always", END=end)
    launcher.run(plan, lambda: None)
    assert films_in(plan) == FILMS
    film, clip = frames(plan.output_dir / "video.mp4"), frames(plan.output_dir / "last-10s.mp4")
    assert len(film) == len(clip)
    differences = [np.abs(first.astype(int) - second).mean() for first, second in zip(film, clip, strict=True)]
    assert max(differences) < 3, "what is filmed afterwards looks like what is filmed while it runs"


def test_with_always_a_run_that_passes_has_no_clip(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of(video="always", END="pass")
    launcher.run(plan, lambda: None)
    assert films_in(plan) == {"video.mp4", "poster.png"}
    [times] = read_timeline((plan.output_dir / TIMELINE_FILE).read_bytes()).videos.values()
    result = json.loads((plan.output_dir / "result.json").read_text())
    assert times.frames == len(frames(plan.output_dir / "video.mp4"))
    assert 0 <= times.ends_s - result["sim_time_s"] <= 1.01 / times.rate_hz, "no frame is missing"


def test_a_run_that_fails_before_its_first_step_says_why_there_is_no_film(launcher: Launcher, make_plan: Any) -> None:
    plan = make_plan(agent="unable", video="on-failure")
    assert launcher.run(plan, lambda: None).status == "Failed"
    assert "The video of the failure is missing: no state was noted: it failed before its first step" in errors_of(plan)


def test_a_camera_that_is_not_there_is_told(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of(END="fail", ROBOMAKER_VIDEO_CAMERA="chase")
    assert launcher.run(plan, lambda: None).status == "Completed"
    assert films_in(plan) == set()
    assert (
        "The video of the failure is missing: "
        "ROBOMAKER_VIDEO_CAMERA: there is no camera 'chase'; the model's cameras are: side" in (errors_of(plan))
    )


def test_what_stands_where_films_are_made_costs_the_film_only(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of()
    (plan.output_dir / ".video.mp4.unfinished").mkdir(parents=True)
    assert launcher.run(plan, lambda: None).status == "Completed"


@pytest.mark.parametrize("kind", ["fifo", "link to zeros", "nested without end"])
def test_a_result_that_programs_have_replaced_is_not_waited_for(plan_of: PlanOf, kind: str) -> None:
    plan = plan_of()
    plan.output_dir.mkdir(parents=True)
    result = plan.output_dir / "result.json"
    if kind == "fifo":
        os.mkfifo(result)
    elif kind == "link to zeros":
        result.symlink_to("/dev/zero")
    else:
        result.write_text("[" * 1_000_000)
    now = datetime.now(UTC)
    outcome = RunOutcome(status="Completed", started_at=now, ended_at=now, timed_out=False, finished=True)
    assert not has_failed(plan, outcome)


def test_filming_ends_when_the_job_is_stopped_or_it_takes_too_long(launcher: Launcher, plan_of: PlanOf) -> None:
    plan = plan_of(END="fail", END_S="100", ROBOMAKER_VIDEO_SIZE="640x480")
    filming = plan.work_dir / "film.log"
    outcome = launcher.run(plan, lambda: RunStop.CANCELED if filming.exists() else None)
    assert (outcome.status, outcome.timed_out) == ("Completed", False), "the run itself was over"
    assert "The video of the failure is missing: the job was stopped (canceled)" in errors_of(plan)
    record_failure_videos(plan, outcome, lambda: None, {}, limit_s=0.3)
    assert "The video of the failure is missing: it took too long" in errors_of(plan)
    assert films_in(plan) == set()
