"""The time line of a job's page in a browser, checked against the job's recording."""

import json
import math
from pathlib import Path
from typing import Any

import httpx
from rosbags.highlevel import AnyReader

from helpers.browser import Page

_POSITION = """(() => {
  const [, x, y, turn] = /translate\\((\\S+) (\\S+)\\) rotate\\((\\S+)\\)/.exec(
    document.querySelector(".robot-now").getAttribute("transform")).map(Number);
  const { left, top, scale } = document.getElementById("timeline").dataset;
  return [x / scale + Number(left), Number(top) - y / scale, -turn * Math.PI / 180];
})()"""
"""Place and heading of the robot on the plan, in metres and radians."""


def wait_for_time_line(page: Page) -> None:
    """Waits until the page has the robot on the plan and all videos that follow."""
    page.wait(lambda page: page.evaluate("document.getElementById('timeline')?.dataset.ready") == "poses", "poses")
    page.wait(lambda page: page.evaluate("[...document.querySelectorAll('video')].every((v) => v.duration)"), "films")


def recorded_poses(url: str, folder: Path) -> list[tuple[float, float, float, float]]:
    """Time, place and heading of all poses of a recording, as another library reads them.

    Args:
        url: Address of `recording.mcap`.
        folder: Where it is kept.
    """
    path = folder / "recording.mcap"
    path.write_bytes(httpx.get(url, timeout=200).raise_for_status().content)
    with AnyReader([path]) as reader:
        wanted = [each for each in reader.connections if each.topic == "/odom"]
        found: list[tuple[float, float, float, float]] = []
        for connection, time_ns, raw in reader.messages(wanted):
            message: Any = reader.deserialize(raw, connection.msgtype)
            place, turn = message.pose.pose.position, message.pose.pose.orientation
            found.append((time_ns / 1e9, place.x, place.y, 2 * math.atan2(turn.z, turn.w)))
    return found


def go_to(page: Page, time_s: float) -> None:
    """Opens a moment, as a link does."""
    page.evaluate(f"location.hash = '#t={time_s}'")
    shown = json.dumps(f"{time_s:.2f} s")
    page.wait(lambda page: page.evaluate(f"document.getElementById('moment-text').textContent == {shown}"), shown)


def check_moment(page: Page, time_s: float, end_s: float, poses: list[tuple[float, float, float, float]]) -> None:
    """Checks that plan, videos, margins and logs show what was recorded at a time."""
    go_to(page, time_s)
    last = [pose for pose in poses if pose[0] <= time_s + 1e-6][-1]
    x, y, heading = page.evaluate(_POSITION)
    assert math.dist((x, y), last[1:3]) < 0.002, (time_s, x, y, last)
    assert abs(math.remainder(heading - last[3], math.tau)) < 0.01, (time_s, heading, last)
    for begins_s, shown_s, duration_s in page.evaluate(
        "[...document.querySelectorAll('video')].map((v) => [Number(v.dataset.begins), v.currentTime, v.duration])"
    ):
        expected = min(max(time_s - begins_s, 0.0), duration_s)
        assert abs(shown_s - expected) < 0.03, (time_s, begins_s, shown_s)
    shares = page.evaluate(
        f"[...document.querySelectorAll('.cursor')].map((c) => c.getAttribute('x1') * {end_s} / 1000)"
    )
    assert shares
    assert all(abs(each - time_s) < 0.01 for each in shares), (time_s, shares)
    lines = "[...document.querySelectorAll('pre.log')].map((log) => [...log.querySelectorAll('[data-t]')]"
    wanted = page.evaluate(
        f"{lines}.filter((line) => Number(line.dataset.t) <= {time_s} + 1e-6).pop()?.innerText ?? null)"
    )
    marked = page.evaluate(f"{lines}.find((line) => line.matches('[aria-current]'))?.innerText ?? null)")
    assert marked == wanted, time_s


def check_time_line(page: Page, files: str, folder: Path) -> None:
    """Checks the time line of the page that is shown: plan, videos, keyboard, button, a video that plays.

    Args:
        page: The page of a job with a recording, a video and a missed requirement.
        files: Address of the job's files.
        folder: Folder of the test.
    """
    wait_for_time_line(page)
    poses = recorded_poses(f"{files}/recording.mcap", folder)
    end_s = float(page.evaluate("document.getElementById('timeline').dataset.end"))
    for share in (0.0, 0.37, 0.9, 1.0):
        check_moment(page, round(end_s * share, 2), end_s, poses)
    go_to(page, 1.0)
    page.evaluate("document.getElementById('moment').focus()")
    for kind in ("keyDown", "keyUp"):
        page.send("Input.dispatchKeyEvent", type=kind, key="ArrowRight", code="ArrowRight", windowsVirtualKeyCode=39)
    assert page.evaluate("document.getElementById('moment').getAttribute('aria-valuetext')").startswith("1.10 s of")
    page.evaluate("document.querySelector('.scrub button').click()")
    violation = page.evaluate("document.querySelector('.moment-list .violation a').hash")
    assert abs(float(violation.removeprefix("#t=")) - float(page.evaluate("location.hash").removeprefix("#t="))) < 0.01
    page.evaluate("(window.film = document.querySelector('video[src$=\"/video.mp4\"]')).muted = true")
    go_to(page, 0.0)
    page.evaluate("film.play()")
    page.wait(lambda page: page.evaluate("Number(document.getElementById('moment').value)") > 0.2, "a video that plays")
    page.evaluate("film.pause()")
