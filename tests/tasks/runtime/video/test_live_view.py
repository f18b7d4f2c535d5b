"""The page of a run that goes on: real server, real pictures."""

import http.client
import io
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import mujoco
import numpy as np
import pytest
from helpers.paths import BUNDLES
from PIL import Image

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ApplicationRole, ProgramPlan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.video.live_view import PATIENCE_S, LiveView
from prefect_robomaker.tasks.runtime.video.video_settings import VideoSettings

FILMED = BUNDLES / "filmed"
MODEL = """
<mujoco><worldbody>
  <camera name="top" pos="0 0 4"/>
  <geom type="plane" size="9 9 .1" rgba="0 .6 0 1"/>
  <body pos="0 0 .3"><freejoint/><geom type="box" size=".5 .5 .3" rgba="1 0 0 1"/></body>
</worldbody></mujoco>
"""


class Stepping:
    """An environment that a test steps, watched by a live view."""

    def __init__(self, plan: RunPlan, camera: str | None = "top", patience_s: float = PATIENCE_S) -> None:
        model = mujoco.MjModel.from_xml_string(MODEL)
        self.physics = SimpleNamespace(model=model, data=mujoco.MjData(model))
        mujoco.mj_forward(model, self.physics.data)
        plan.work_dir.mkdir(parents=True, exist_ok=True)
        self.view = LiveView(plan, "rays", VideoSettings(camera, (160, 120)), patience_s=patience_s)
        self.time_s = 0.0

    def step(self) -> None:
        self.time_s += 0.1
        self.view.watch(self, self.time_s)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Steps in a thread of its own, as a run does."""
        over = threading.Event()

        def run() -> None:
            while not over.is_set():
                self.step()
                time.sleep(0.005)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def get(self, path: str, **headers: str) -> tuple[int, http.client.HTTPMessage, bytes]:
        assert self.view.url is not None
        return get(self.view.url, path, **headers)


def get(url: str, path: str, **headers: str) -> tuple[int, http.client.HTTPMessage, bytes]:
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=200)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


@pytest.fixture
def stepping(make_plan: Callable[..., RunPlan]) -> Iterator[Stepping]:
    stepping = Stepping(make_plan(live_view_port=0))
    yield stepping
    stepping.view.close("environment")


def test_its_address_is_told(stepping: Stepping, make_plan: Any, capsys: pytest.CaptureFixture[str]) -> None:
    file = make_plan().work_dir / "live-view.json"
    assert json.loads(file.read_text())["url"] == stepping.view.url
    assert stepping.view.url is not None
    assert stepping.view.url.startswith("http://127.0.0.1:")
    stepping.view.close("environment")
    assert not file.exists()
    with pytest.raises(ConnectionError):
        stepping.get("/")


def test_the_page_and_the_status(stepping: Stepping) -> None:
    status, headers, page = stepping.get("/")
    assert status == 200
    assert headers["Content-Type"] == "text/html; charset=utf-8"
    assert b"<title>Simulation job, live</title>" in page
    assert json.loads(stepping.get("/status.json")[2])["state"] == "starting"
    for _ in range(12):
        stepping.step()
    told = json.loads(stepping.get("/status.json")[2])
    assert (told["job"], told["run"], told["seed"], told["state"]) == ("sim-7", "run-1", 5, "running")
    assert told["sim_time_s"] == pytest.approx(1.2)


def test_who_looks_sees_how_the_run_goes_on(stepping: Stepping) -> None:
    with stepping.running():
        status, headers, first = stepping.get("/frame.jpg")
        assert (status, headers["Content-Type"]) == (200, "image/jpeg")
        number = int(headers["X-Frame"])
        stepping.physics.data.qpos[0] = 1.2
        later = first
        for _ in range(3):  # one may have been on its way
            status, headers, later = stepping.get(f"/frame.jpg?after={number}")
            assert int(headers["X-Frame"]) > number
            number = int(headers["X-Frame"])
    columns = []
    for jpeg in (first, later):
        picture = np.asarray(Image.open(io.BytesIO(jpeg))).astype(int)
        assert picture.shape == (120, 160, 3)
        columns.append(np.nonzero(picture[..., 0] > picture[..., 1] + 50)[1].mean())
    assert columns[1] > columns[0] + 20, "the box went to the right"


def test_nothing_is_drawn_without_a_viewer_and_at_most_five_pictures_a_second(stepping: Stepping) -> None:
    with stepping.running():
        time.sleep(0.3)
        assert "live view" not in {thread.name for thread in threading.enumerate()}
        number, began = 0, time.monotonic()
        while time.monotonic() - began < 1.0:
            number = int(stepping.get(f"/frame.jpg?after={number}")[1]["X-Frame"])
        assert number <= (time.monotonic() - began) / 0.2 + 1
        time.sleep(2.0)
        # Ten, if it still drew; for half a second after the last question it does, and draws one for the next.
        assert int(stepping.get("/frame.jpg")[1]["X-Frame"]) <= number + 5


def test_the_camera_can_be_chosen(stepping: Stepping) -> None:
    with stepping.running():
        _, headers, top = stepping.get("/frame.jpg")
        _, headers, _ = stepping.get(f"/frame.jpg?after={headers['X-Frame']}&camera=follow")
        _, _, follow = stepping.get(f"/frame.jpg?after={headers['X-Frame']}&camera=follow")
        assert stepping.get("/frame.jpg?camera=chase")[0] == 400
    pictures = [np.asarray(Image.open(io.BytesIO(jpeg))).astype(int) for jpeg in (top, follow)]
    assert np.abs(pictures[0] - pictures[1]).mean() > 5
    assert json.loads(stepping.get("/status.json")[2])["camera"] == "follow"


def test_a_stream_for_other_programs(stepping: Stepping) -> None:
    assert stepping.view.url is not None
    with stepping.running(), socket.create_connection(("127.0.0.1", urlsplit(stepping.view.url).port)) as client:
        client.sendall(b"GET /stream.mjpg HTTP/1.1\r\nHost: localhost\r\n\r\n")
        received = b""
        while received.count(b"\r\n--frame\r\n") < 2:
            received += client.recv(65536)
    assert b"multipart/x-mixed-replace; boundary=frame" in received
    assert received.count(b"\xff\xd8\xff") >= 2


@pytest.mark.parametrize(("path", "status"), [("/nothing", 404), ("/frame.jpg?after=x", 400), ("/../etc/passwd", 404)])
def test_what_is_not_there(stepping: Stepping, path: str, status: int) -> None:
    assert stepping.get(path)[0] == status


def test_it_answers_to_this_machine_only(stepping: Stepping) -> None:
    assert stepping.get("/", Host="evil.example")[0] == 403
    assert stepping.get("/", Host="localhost:9000")[0] == 200
    assert stepping.get("/status.json", Host="127.0.0.1")[0] == 200


def test_without_a_step_there_is_no_picture(make_plan: Any) -> None:
    stepping = Stepping(make_plan(live_view_port=0), patience_s=0.1)
    assert stepping.get("/frame.jpg")[0] == 204
    stepping.view.close("environment")


def test_a_port_that_is_taken_fails_nothing(make_plan: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        stepping = Stepping(make_plan(live_view_port=port))
    assert stepping.view.url is None
    assert stepping.view.next_time_s == float("inf")
    assert f"No live view: port {port} of 127.0.0.1" in capsys.readouterr().err
    stepping.view.close("environment")


def plan_of(make_plan: Any, run_id: str, arena: dict[str, str], **members: Any) -> RunPlan:
    def planned(role: ApplicationRole, name: str, **variables: str) -> ApplicationPlan:
        attribute = f"filmed.arena.{name}"
        return ApplicationPlan(role=role, name=name, attribute=attribute, path=FILMED, environment_variables=variables)

    simulation = planned("simulation", "make_environment", END_S="3", **arena)
    driver = planned("robot", "make_agent")
    return make_plan(simulation_application=simulation, robot_application=driver, run_id=run_id, **members)


@pytest.mark.deep
def test_a_run_is_the_same_whether_somebody_looks_or_not(launcher: Launcher, make_plan: Any, tmp_path: Path) -> None:
    looked = tmp_path / "looked"
    slowly = {"PAUSE_S": "0.2", "UNTIL": str(looked)}  # 30 s for the viewer, who needs less than one
    alone, watched = plan_of(make_plan, "alone", {}), plan_of(make_plan, "watched", slowly, live_view_port=0)
    file = watched.work_dir / "live-view.json"

    def look() -> list[int]:
        while not file.exists():
            time.sleep(0.001)
        url = json.loads(file.read_text())["url"]
        try:
            while (first := get(url, "/frame.jpg")[0]) == 204:
                pass  # no picture came in the time that an answer waits for one: the machine is busy
            return [first, get(url, "/frame.jpg")[0]]
        finally:
            looked.touch()

    with ThreadPoolExecutor(1) as viewer:
        seen = viewer.submit(look)
        assert [launcher.run(plan, lambda: None).status for plan in (alone, watched)] == ["Completed"] * 2
        assert seen.result() == [200, 200]
    results = [json.loads((plan.output_dir / "result.json").read_text()) for plan in (alone, watched)]
    assert results[0]["metrics"] == results[1]["metrics"]
    assert results[0]["state_digest"] == results[1]["state_digest"] != None  # noqa: E711
    assert "Live view: http://127.0.0.1:" in (watched.output_dir / "logs" / "stdout.log").read_text()
    assert not file.exists()


@pytest.mark.deep
def test_the_screen_of_a_program_is_refused_in_the_log(launcher: Launcher, make_plan: Any, tmp_path: Path) -> None:
    program = ProgramPlan(
        name="robot", role="robot", kind="application", argv=["/bin/sh", "-c", "echo hello"], folder=tmp_path
    )
    plan = make_plan(
        simulation_application=None,
        robot_application=ApplicationPlan(role="robot", name="driver"),
        programs=[program],
        live_view_port=0,
    )
    assert launcher.run(plan, lambda: None).status == "Completed"
    assert "streamUI: the screen of a program cannot be shown" in (plan.output_dir / "logs/stderr.log").read_text()
