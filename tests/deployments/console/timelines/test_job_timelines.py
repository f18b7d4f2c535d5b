"""The time line of a job's page: what is in step, and what it says of parts that are missing."""

import json
import re
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import NEEDS_BROWSER, browsing
from helpers.endpoint_here import ServeHere

from prefect_robomaker.schemas.runs.plan import Collision, Requirement, RoomVisit, RunResult
from prefect_robomaker.tasks.runtime.episode.run_timeline import FilmTimes, LogSeries, MarginSeries, RunTimeline
from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder

END_S = 40.0
RESULT = RunResult(
    verdict="FAIL", sim_time_s=END_S, wall_time_s=1, real_time_factor=20, ended_by="environment", seed=1,
    rooms=[RoomVisit(name="Hall", visited=True, first_visit_s=3)],
    collisions=[Collision(time_s=12.5, duration_s=0.1, x=0, y=0, other="chair_3", max_force_N=12.34)],
    requirements=[
        Requirement(name="soft", satisfied=False, detail="12 N", first_violation_s=12.5, margin=-7, unit="N"),
    ],
    path=[(0.0, 0.0, -1.0), (20.0, 2.0, -1.0), (40.0, 4.0, -1.0)],
)  # fmt: skip
TIMELINE = RunTimeline(
    margins=[MarginSeries(requirement="soft", unit="N", samples=[(0.0, 5.0), (12.5, -7.0)])],
    logs=[LogSeries(name="logs/stdout.log", samples=[(0.0, 6), (12.5, 12)])],
    videos={
        "video.mp4": FilmTimes(begins_s=0, rate_hz=10, frames=401),
        "last-10s.mp4": FilmTimes(begins_s=30, rate_hz=10, frames=101),
    },
)


@pytest.fixture
def recording(tmp_path: Path) -> bytes:
    """A recording of 40 s at 50 Hz, with more poses than a page gets: at `t` the robot is at x = t / 10."""
    path = tmp_path / "recorded" / "recording.mcap"
    path.parent.mkdir()
    with McapRecorder(path) as recorder:
        for index in range(501):
            time_s = index * END_S / 500
            pose = ros.Pose(ros.Vector3(time_s / 10, -1.0, 0.0), ros.Quaternion(0.0, 0.0, 1.0, 0.0))
            header = ros.Header(ros.Time.from_seconds(time_s), "odom")
            recorder.write("/odom", ros.Odometry(header, "base_link", pose, ros.Twist()), time_s)
    return path.read_bytes()


def outputs(result: RunResult | None = RESULT, timeline: RunTimeline | None = TIMELINE, **files: bytes) -> Any:
    """Files of a run, with underscores for dots in the names of further ones."""
    found = {name.replace("_", "."): content for name, content in files.items()}
    if result is not None:
        found["result.json"] = result.model_dump_json().encode()
    if timeline is not None:
        found["timeline.json"] = timeline.model_dump_json().encode()
    return found


def gaps(page: str) -> list[str]:
    found = re.search(r'id="gaps">(.*?)</ul>', page, re.DOTALL)
    return [] if found is None else [unescape(each) for each in re.findall(r"<li>(.*?)</li>", found[1])]


def test_a_page_has_poses_marks_margins_and_times_of_lines_and_videos(
    browser: Any, store_job: Callable[..., str], recording: bytes
) -> None:
    files = outputs(recording_mcap=recording, video_mp4=b"film") | {
        "last-10s.mp4": b"film", "logs/stdout.log": b"first\ntouch\nlast\n",
    }  # fmt: skip
    job = store_job(verdict="FAIL", files=files)
    page = browser.get(f"/console/jobs/{job}").text
    assert gaps(page) == []
    assert re.findall(r'href="#t=([\d.]+)"', page) == ["3.0", "12.5", "12.5"]
    assert "robot touches chair_3, 12.3 N" in page
    assert "Jump to the first violation" in page
    assert '<span data-t="0.0">first\n</span><span data-t="12.5">touch\n</span><span>last\n</span>' in page
    assert 'data-begins="0.0" data-rate="10.0" data-frames="401"' in page
    assert page.count("<video") == 1, "the whole run is played, and the clip of its end is a link"
    assert f'the last ten seconds alone: <a href="/console/jobs/{job}/files/last-10s.mp4">' in page
    assert 'class="too-early"' not in page
    assert json.loads(unescape(re.findall(r'data-samples="([^"]*)"', page)[0])) == [[0.0, 5.0], [12.5, -7.0]]
    sent = browser.get(f"/console/jobs/{job}/timeline").json()
    assert sent["missing"] == []
    assert sent["end_s"] == END_S
    assert [pose[1] for pose in sent["poses"]] == pytest.approx([pose[0] / 10 for pose in sent["poses"]])
    assert all(abs(abs(pose[3]) - 3.1416) < 1e-3 for pose in sent["poses"])
    assert "style=" not in page.partition('id="timeline"')[2].partition("</section>")[0], "the policy allows none"


def test_plan_and_video_stand_right_above_the_slider_and_the_result_has_no_empty_half(
    browser: Any, store_job: Callable[..., str]
) -> None:
    job = store_job(verdict="FAIL", files=outputs(video_mp4=b"film") | {"logs/stdout.log": b"first\ntouch\nlast\n"})
    page = browser.get(f"/console/jobs/{job}").text
    parts = (
        'class="plan',
        "<video",
        'id="moment"',
        'class="moment-list"',
        'class="margins"',
        'id="log-1"',
        'id="result-title"',
    )
    assert [page.count(each) for each in parts] == [1] * len(parts)
    assert sorted(parts, key=page.index) == list(parts)
    assert 'class="pictures"' not in page, "the plan is beside the video"


def test_a_clip_of_the_end_says_why_it_is_dim_and_a_job_without_video_how_to_get_one(
    browser: Any, store_job: Callable[..., str]
) -> None:
    clip = outputs() | {"last-10s.mp4": b"film"}
    job = store_job(verdict="FAIL", files=clip)
    page = browser.get(f"/console/jobs/{job}").text
    assert "This video begins at 30.00 s. It is dim while an earlier moment is chosen." in page
    none = {policy: store_job(verdict="FAIL", files=outputs() | {"provenance.json": b"{}"}, video=policy)
            for policy in ("none", "on-failure")}  # fmt: skip
    asked = browser.get(f"/console/jobs/{none['none']}").text
    how = (
        "<code>video: on-failure</code> in the request makes one of each run that fails, <code>video: always</code> one"
    )
    assert f"There is no video: the request asks for none. {how} of every run." in asked
    assert f"<code>robomaker repro {none['none']}</code>" in asked.partition('id="video"')[2].partition("</section>")[0]
    assert "There is no video: none is stored." in browser.get(f"/console/jobs/{none['on-failure']}").text


@pytest.mark.deep
@NEEDS_BROWSER
@pytest.mark.parametrize(("width", "height"), [(1280, 900), (400, 800)])
def test_a_jump_to_the_violation_moves_what_is_on_the_first_screen(
    serve_here: ServeHere, store_job: Callable[..., str], recording: bytes, tmp_path: Path, width: int, height: int
) -> None:
    job = store_job(verdict="FAIL", files=outputs(recording_mcap=recording, video_mp4=b"no film"))
    with serve_here() as served, browsing(tmp_path / "profile") as browser, browser.page() as page:
        page.load(f"{served.url}/console/jobs/{job}", width)
        page.wait(lambda page: page.evaluate("document.getElementById('timeline')?.dataset.ready") == "poses", "poses")
        place = "document.querySelector('.robot-now').getBoundingClientRect()"
        before = page.evaluate(f"{place}.left")
        page.evaluate("document.querySelector('.scrub button').click()")
        assert page.evaluate(f"{place}.left") > before + 5
        assert page.evaluate(f"scrollY + {place}.bottom") < height
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        if width == 1280:
            tops = page.evaluate(
                "['.seen .plan', '.seen video'].map((e) => document.querySelector(e).getBoundingClientRect().top)"
            )
            assert abs(tops[0] - tops[1]) < 40, "side by side"


def test_what_is_missing_is_said_and_the_rest_is_there(browser: Any, store_job: Callable[..., str]) -> None:
    bare = store_job(verdict="FAIL", files=outputs(timeline=None))
    page = browser.get(f"/console/jobs/{bare}").text
    assert [each.partition(":")[0].partition(",")[0] for each in gaps(page)] == [
        "There are no margins",
    ]
    assert "robot touches chair_3" in page
    sent = browser.get(f"/console/jobs/{bare}/timeline").json()
    assert sent["missing"] == ["There is no recording. The plan has the places of result.json, without headings."]
    assert sent["poses"] == [[0.0, 0.0, -1.0, None], [20.0, 2.0, -1.0, None], [40.0, 4.0, -1.0, None]]
    nothing = store_job("Failed", files={"logs/stderr.log": b"boom"})
    assert gaps(browser.get(f"/console/jobs/{nothing}").text) == [
        "There is no time line: the run left no simulated time."
    ]
    running = store_job("Running")
    assert "The time line comes" in browser.get(f"/console/jobs/{running}").text
    assert browser.get(f"/console/jobs/{running}/timeline").json()["poses"] == []


@pytest.mark.parametrize("path", [[(0.0, 0.0, -1.0), (20.0, 2.4, -1.0)], [(40.0, 4.0, 0.0)], []])
def test_places_of_another_odometry_are_not_shown(
    browser: Any, store_job: Callable[..., str], recording: bytes, path: list[tuple[float, float, float]]
) -> None:
    job = store_job(verdict="FAIL", files=outputs(RESULT.model_copy(update={"path": path}), recording_mcap=recording))
    sent = browser.get(f"/console/jobs/{job}/timeline").json()
    assert sent["missing"][0].startswith("The places on /odom are not those of result.json.")
    assert [tuple(pose[:3]) for pose in sent["poses"]] == path


@pytest.mark.parametrize(("frames", "is_in_step"), [(401, True), (395, False), (410, False), (800, False)])
def test_a_video_that_lasts_otherwise_than_the_run_is_not_in_step(
    browser: Any, store_job: Callable[..., str], frames: int, is_in_step: bool
) -> None:
    videos = {"video.mp4": FilmTimes(begins_s=0, rate_hz=10, frames=frames)}
    job = store_job(verdict="FAIL", files=outputs(timeline=RunTimeline(videos=videos), video_mp4=b"film"))
    page = browser.get(f"/console/jobs/{job}").text
    assert ("data-begins" in page) == is_in_step
    assert any("video.mp4 does not follow" in each for each in gaps(page)) != is_in_step
    assert "/files/video.mp4" in page


def test_a_video_without_recorded_times_is_not_in_step(browser: Any, store_job: Callable[..., str]) -> None:
    job = store_job(verdict="FAIL", files=outputs(timeline=RunTimeline(), video_mp4=b"film"))
    assert "video.mp4 does not follow: its simulated times are not recorded." in gaps(
        browser.get(f"/console/jobs/{job}").text
    )


def test_a_job_with_trials_shows_one_that_was_recorded(
    browser: Any, store_job: Callable[..., str], recording: bytes
) -> None:
    summary = {"planned": 3, "counts": {"passed": 2, "failed": 1}, "recorded": [1, 2]}
    whole = RESULT.model_copy(update={"rooms": [], "collisions": [], "path": [], "extra": {"trials": summary}})
    files = outputs(whole, None, video_mp4=b"film of nobody knows what")
    for trial in (1, 2):
        end_s = END_S if trial == 2 else 20.0
        own = RESULT.model_copy(update={"sim_time_s": end_s})
        files |= {f"trials/{trial:06d}/{name}": data for name, data in outputs(own, recording_mcap=recording).items()}
    job = store_job(verdict="FAIL", files=files | {"provenance.json": b"{}"})
    page = browser.get(f"/console/jobs/{job}").text
    assert "Time line of trial 1" in page
    assert f'data-poses="/console/jobs/{job}/timeline?trial=1" data-end="20.0"' in page
    assert "Path of trial 1" in page
    assert 'aria-current="page">trial 1' in page
    other = browser.get(f"/console/jobs/{job}?trial=2").text
    assert f'timeline?trial=2" data-end="{END_S}"' in other
    again = other.partition('id="again-title"')[2]
    for command in ("repro", "verify"):
        assert f'<code>robomaker {command} {job} <span class="whole">--trial 2</span></code>' in again
    assert "They repeat trial 2; without <code>--trial</code>, the first trial that did not pass." in again
    assert browser.get(f"/console/jobs/{job}/timeline?trial=2").json()["end_s"] == END_S
    unrecorded = browser.get(f"/console/jobs/{job}?trial=0").text
    assert "data-end" not in unrecorded, "the time line of another trial would be taken for its own"
    assert "/files/video.mp4" not in unrecorded.partition('class="trouble"')[0]
    assert gaps(unrecorded)[0].startswith("Trial 0 was not recorded, so there is no time line, video or plan")
    assert f'robomaker repro {job} <span class="whole">--trial 0</span>' in unrecorded
    assert 'href="?trial=1"' in unrecorded
    for no_trial in ("3", "-1", "², ", "9" * 30, "x"):
        assert "Time line of trial 1" in browser.get(f"/console/jobs/{job}", params={"trial": no_trial}).text
    assert browser.get(f"/console/jobs/{job}/timeline?trial=0").json()["poses"] == []
    summary["recorded"] = []
    bare = store_job(verdict="FAIL", files=outputs(whole.model_copy(update={"extra": {"trials": summary}})))
    assert gaps(browser.get(f"/console/jobs/{bare}").text)[0].startswith("None of its trials was recorded")


def test_a_failed_job_opens_on_a_trial_that_failed_and_its_trials_have_the_values_of_their_axes(
    browser: Any, store_job: Callable[..., str]
) -> None:
    """It opened on trial 0, which had passed, under a red "failed"."""
    bad = {"seed": 1, "verdict": "FAIL", "reason": "gentle: 40 N"}
    failing = [{**bad, "trial": 2, "axes": {"SPEED": "fast"}}, {**bad, "trial": 3, "axes": {"SPEED": "slow"}}]
    summary = {"planned": 4, "counts": {"passed": 2, "failed": 2}, "recorded": [0, 2], "failing": failing}
    files = outputs(RESULT.model_copy(update={"extra": {"trials": summary}}), None)
    for trial in (0, 2):
        files |= {f"trials/{trial:06d}/{name}": data for name, data in outputs().items()}
    job = store_job(verdict="FAIL", files=files)
    page = browser.get(f"/console/jobs/{job}").text
    assert "Time line of trial 2" in page
    assert 'trial 2 <span class="sub">SPEED=fast</span>' in page
    unrecorded = browser.get(f"/console/jobs/{job}?trial=3").text
    assert "Trial 3 with seed 1, SPEED=slow: gentle: 40 N" in unrecorded


def test_a_recorded_trial_has_lines_of_its_own_log_and_a_link_from_its_row(
    browser: Any, store_job: Callable[..., str]
) -> None:
    row = {"trial": 2, "seed": 2, "verdict": "FAIL", "reason": "soft", "recorded": True}
    summary = {"planned": 3, "counts": {"passed": 2, "failed": 1}, "recorded": [1, 2], "failing": [row]}
    files = outputs(RESULT.model_copy(update={"extra": {"trials": summary}}), None)
    files |= {"logs/stdout.log": b"all of the job", "trials/000001/result.json": RESULT.model_dump_json().encode()}
    files |= {f"trials/000002/{name}": data for name, data in outputs().items()}
    files["trials/000002/logs/stdout.log"] = b"first\ntouch\nlast\n"
    job = store_job(verdict="FAIL", files=files)
    page = browser.get(f"/console/jobs/{job}?trial=2").text
    assert '<span data-t="0.0">first\n</span><span data-t="12.5">touch\n</span><span>last\n</span>' in page
    assert "all of the job" not in page
    assert page.count('class="plan') == 1, "the plan of the trial that is shown is enough"
    assert not any("log does not follow" in each for each in gaps(page))
    assert '<a href="?trial=2#timeline-title">2</a>' in page
    other = browser.get(f"/console/jobs/{job}?trial=1").text
    assert "<span>all of the job\n</span>" in other, "an earlier version recorded it without a log"


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (None, ""),
        ({"verdict": "PASS", "requirements": []}, "No violation."),
        ({"requirements": [Requirement(name="there", satisfied=False, detail="0.7 m away")]}, "at no single moment"),
        (
            {"requirements": [Requirement(name="there", satisfied=False, detail="", error="no body")]},
            "no single moment",
        ),
        ({"verdict": "FAIL", "requirements": []}, "at no single moment"),
        (
            {"verdict": "PASS", "requirements": [Requirement(name="a", satisfied=False, detail="", counts=False)]},
            "No violation.",
        ),
    ],
)
def test_a_run_without_a_moment_of_violation_is_clean_only_if_it_missed_nothing(
    browser: Any, store_job: Callable[..., str], result: dict[str, Any] | None, said: str
) -> None:
    found = None if result is None else RESULT.model_copy(update=result)
    page = browser.get(f"/console/jobs/{store_job(verdict='FAIL', files=outputs(found))}").text
    head = page.partition('<div class="moment">')[2].partition("</div>")[0]
    assert said in head
    assert ("No violation." in head) == (said == "No violation.")


def test_numbers_that_no_page_can_have_are_left_out(browser: Any, store_job: Callable[..., str]) -> None:
    """Programs of a run may have written its files, and JSON has no such numbers."""
    text = RESULT.model_dump_json().replace("[20.0,2.0,-1.0]", "[20.0,NaN,-1.0]")
    series = '{"margins":[{"requirement":"soft","samples":[[0.0,NaN],[1.0,2.0],[Infinity,3.0]]}]}'
    job = store_job(verdict="FAIL", files={"result.json": text.encode(), "timeline.json": series.encode()})
    sent = browser.get(f"/console/jobs/{job}/timeline").json()
    assert [pose[0] for pose in sent["poses"]] == [0.0, 40.0]
    page = browser.get(f"/console/jobs/{job}").text
    assert [json.loads(unescape(each)) for each in re.findall(r'data-samples="([^"]*)"', page)] == []
    endless = store_job(verdict="FAIL", files={"result.json": text.replace(":40.0", ":Infinity").encode()})
    assert gaps(browser.get(f"/console/jobs/{endless}").text)[0].startswith("There is no time line")
    assert browser.get(f"/console/jobs/{endless}/timeline").json()["poses"] == []


def test_a_trial_that_left_nothing_leads_to_the_others(browser: Any, store_job: Callable[..., str]) -> None:
    summary = {"planned": 2, "counts": {"passed": 1, "failed": 1}, "recorded": [1, 2]}
    files = outputs(RESULT.model_copy(update={"extra": {"trials": summary}}), None)
    files |= {"trials/000001/video.mp4": b"film"} | {f"trials/000002/{name}": data for name, data in outputs().items()}
    job = store_job(verdict="FAIL", files=files)
    page = browser.get(f"/console/jobs/{job}").text
    assert gaps(page) == ["There is no time line: trial 1 left no simulated time."]
    assert 'href="?trial=2"' in page
    assert f'src="/console/jobs/{job}/files/trials/000001/video.mp4"' in page
    assert "data-end" not in page
    assert "data-end" in browser.get(f"/console/jobs/{job}?trial=2").text


def test_the_control_reaches_the_end_of_a_run(browser: Any, store_job: Callable[..., str]) -> None:
    """Steps of a control are tenths of a second, and what goes beyond the end is that."""
    job = store_job(verdict="FAIL", files=outputs(RESULT.model_copy(update={"sim_time_s": 40.02})))
    [most] = re.findall(r'id="moment" min="0" max="([^"]+)"', browser.get(f"/console/jobs/{job}").text)
    assert float(most) == 40.1
