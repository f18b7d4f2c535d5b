"""Live view of a run: a web page, and images that a thread renders while a viewer is connected."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import copy
import io
import json
import os
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from ....schemas.runs.plan import RunPlan
from ...files.untrusted_files import write_anew
from ..episode.physics import raw_physics
from ..episode.run_results import Findings, Observer
from ..rendering.views import BOTH, FOLLOW, MODEL_BORROWED, TOP, awake, work_out_places
from .video import RAYS, ViewRenderer
from .video_settings import LIVE_VIEW_FILE, VideoSettings

INTERVAL_S = 0.2
"""Minimum wall-clock seconds between two images."""
_JPEG_QUALITY = 82
_PATIENCE_S = 1.0
"""Time limit in seconds for finishing the last image."""


@dataclass(frozen=True)
class _State:
    model: mujoco.MjModel
    camera: str | None
    time_s: float
    places: list[NDArray[np.float64]]


class LiveFrames:
    """Passes simulation states to a rendering thread, and its images to the live view's viewers.

    The simulation thread only reads a flag while no viewer waits, and copies positions when one does.
    """

    def __init__(self, backend: str | None, settings: VideoSettings) -> None:
        """Prepares the images of a run's live view; nothing is rendered before a viewer waits.

        Args:
            backend: `egl` or `osmesa`; None or `rays`: ray casting.
            settings: Camera and size.
        """
        self.camera = settings.camera
        """Name of the view: `follow`, `top`, `both`, or a camera of the model."""
        self.problem = ""
        """Reason why the live view has no images; empty if it has."""
        self.closed = False
        """Whether the run is over."""
        self._backend, self._settings = backend or RAYS, settings
        self._changed = threading.Condition()
        self._waiting = 0
        self._wanted = False
        self._next_s = 0.0
        self._state: _State | None = None
        self._number, self._jpeg = 0, b""
        self._drawer: threading.Thread | None = None

    def offer(self, environment: Any, time_s: float) -> None:
        """Copies the current positions for the drawing thread, if a viewer waits for a picture and one is due.

        The first such call starts the thread.
        """
        if not self._wanted or time.monotonic() < self._next_s:
            return
        model, data = raw_physics(environment.physics)
        places = [data.qpos.copy(), data.mocap_pos.copy(), data.mocap_quat.copy()]
        with self._changed:
            self._wanted = False
            self._next_s = time.monotonic() + INTERVAL_S
            self._state = _State(model, getattr(environment, "video_camera", None), time_s, places)
            if self._drawer is None:
                self._drawer = threading.Thread(target=self._draw_all, name="live view", daemon=True)
                self._drawer.start()
            self._changed.notify_all()

    def next_after(self, number: int, timeout_s: float) -> tuple[int, bytes]:
        """Waits for a new picture of the live view, and returns it.

        Args:
            number: Number of the image that the caller has; 0: none.
            timeout_s: Maximum seconds to wait.

        Returns:
            The number of the newest picture and the picture as JPEG; the same number when there is no newer one.
        """
        with self._changed:
            self._waiting += 1
            self._wanted = True
            try:
                self._changed.wait_for(lambda: self._number > number or self.closed, timeout_s)
            finally:
                self._waiting -= 1
                self._wanted = self._waiting > 0
            return self._number, self._jpeg

    def close(self) -> None:
        """Releases all waiting viewers, and waits a limited time until the rendering thread has ended."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()
        if self._drawer is not None:
            self._drawer.join(_PATIENCE_S)

    def _draw_all(self) -> None:
        try:
            self._draw_with(self._backend)
        except Exception as error:
            sys.stderr.write(f"Live view: no pictures with {self._backend}: {type(error).__name__}: {error}\n")
            if self._backend == RAYS:
                self.problem = f"{type(error).__name__}: {error}"
                return
            self._backend = RAYS
            self._draw_all()

    def _draw_with(self, backend: str) -> None:
        easel: _Easel | None = None
        while (state := self._next_state()) is not None:
            if easel is None or easel.model is not state.model:
                if easel is not None:
                    easel.close()
                easel = _Easel(state, replace(self._settings, camera=self.camera), backend)
            self._publish(easel.draw(state, self.camera))
        if easel is not None:
            easel.close()

    def _next_state(self) -> _State | None:
        with self._changed:
            self._changed.wait_for(lambda: self._state is not None or self.closed)
            state, self._state = self._state, None
            return None if self.closed else state

    def _publish(self, jpeg: bytes) -> None:
        with self._changed:
            self._number, self._jpeg = self._number + 1, jpeg
            self._changed.notify_all()


class _Easel:
    """Renderer of the live view's pictures of one model, which works on a copy of the model in its own thread."""

    def __init__(self, state: _State, settings: VideoSettings, backend: str) -> None:
        self.model = state.model
        with MODEL_BORROWED:
            self._model = awake(copy.copy(state.model))
        self._data = mujoco.MjData(self._model)
        self._camera = settings.camera
        self._renderer = ViewRenderer(self._model, settings, backend, state.camera)

    def draw(self, state: _State, camera: str | None) -> bytes:
        if camera != self._camera:
            self._renderer.aim(camera or state.camera, "the camera")
            self._camera = camera
        data = self._data
        data.time = state.time_s
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = state.places
        work_out_places(self._model, data)
        buffer = io.BytesIO()
        PillowImage.fromarray(self._renderer.picture(data)).save(buffer, format="JPEG", quality=_JPEG_QUALITY)
        return buffer.getvalue()

    def close(self) -> None:
        self._renderer.close()


_ADDRESS = "127.0.0.1"
_PAGE = Path(__file__).with_name("live_view.html")
_CHECK_EVERY_S = 0.1
"""Simulated seconds between two checks whether a viewer is connected."""
PATIENCE_S = 2.0
"""Maximum seconds that a request waits for the next image."""
_MAX_VIEWERS = 16
_LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})
_BOUNDARY = "frame"


class LiveView(Observer):
    """Observer that serves a web page with live images of the simulation.

    If the page cannot be served, such as because the port is taken, the run does not fail: the error log says why.
    """

    def __init__(
        self,
        plan: RunPlan,
        backend: str | None,
        settings: VideoSettings,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """Starts the server of a run's live view, and writes its URL to the log and to `live-view.json`.

        If the port cannot be used, that is written to standard error, and there is no live view.

        Args:
            plan: Plan of the run; `live_view_port` is the port, 0 for any free one.
            backend: Rendering backend; None: ray casting.
            settings: Camera and size.
            patience_s: Maximum seconds that a request waits for the next image.
        """
        self.url: str | None = None
        self._server: _Server | None = None
        self._plan = plan
        self._frames = LiveFrames(backend, settings)
        self._state, self._time_s = "starting", 0.0
        self._began_s = time.monotonic()
        self._file = plan.work_dir / LIVE_VIEW_FILE
        try:
            address = (_ADDRESS, plan.live_view_port or 0)
            self._server = server = _Server(address, self._frames, self.status, patience_s)
        except OSError as error:
            self.next_time_s = float("inf")
            sys.stderr.write(f"No live view: port {plan.live_view_port} of {_ADDRESS}: {error}\n")
            return
        self.url = f"http://{_ADDRESS}:{server.server_address[1]}/"
        threading.Thread(target=server.serve, name="live view server", daemon=True).start()
        write_anew(self._file, json.dumps({"url": self.url, "pid": os.getpid()}).encode())
        sys.stdout.write(f"Live view: {self.url}\n")

    def watch(self, environment: Any, time_s: float) -> None:
        """Updates the time that is shown, and passes on the state if a viewer waits for a picture."""
        if self._state == "starting":
            self._state, self._began_s = "running", time.monotonic()
        self._time_s = time_s
        self._frames.offer(environment, time_s)
        self.next_time_s = time_s + _CHECK_EVERY_S

    def close(self, ended_by: str | None) -> Findings:
        """Ends the web server of the live view, and deletes the file with its address; returns no findings."""
        del ended_by
        self._file.unlink(missing_ok=True)
        self._frames.close()
        if self._server is not None:
            self._server.stop()
        return Findings()

    def restore(self, state: float, environment: Any) -> None:
        """Restores nothing: the live view of a resumed run begins anew."""

    def status(self) -> dict[str, Any]:
        """Returns the run's status that is shown beside the live picture, as JSON members; times are in seconds."""
        wall_s = time.monotonic() - self._began_s
        return {
            "job": self._plan.job_id,
            "run": self._plan.run_id,
            "seed": self._plan.seed,
            "state": self._state,
            "sim_time_s": round(self._time_s, 3),
            "wall_time_s": round(wall_s, 3),
            "speed": round(self._time_s / wall_s, 2) if wall_s > 0 else 0.0,
            "camera": self._frames.camera or "",
            "problem": self._frames.problem,
        }


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = _MAX_VIEWERS

    def __init__(
        self,
        address: tuple[str, int],
        frames: LiveFrames,
        status: Callable[[], dict[str, Any]],
        patience_s: float,
    ) -> None:
        super().__init__(address, _Handler)
        self.frames, self.status, self.patience_s = frames, status, patience_s
        self._stopped = False
        self.viewers = threading.BoundedSemaphore(_MAX_VIEWERS)

    def serve(self) -> None:
        """Serves HTTP requests of the live view until stopped; sleeps while no viewer is connected."""
        while not self._stopped:
            self.handle_request()
        self.server_close()

    def stop(self) -> None:
        """Stops the live view's web server."""
        self._stopped = True
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)  # wakes it

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignores every error of a viewer's request, such as a disconnection, so that nothing is printed."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = 30

    @property
    def _page(self) -> _Server:
        assert isinstance(self.server, _Server)
        return self.server

    def do_GET(self) -> None:
        """Answers a viewer's HTTP request: the page, the status, a picture or a stream of pictures, else 404.

        Requests to names other than this machine's own are refused with 403.
        """
        host = (self.headers.get("Host") or "").rsplit(":", 1)[0].lower()
        if host not in _LOCAL_NAMES:  # a page from elsewhere whose name was made to point here
            self._answer(403, "text/plain; charset=utf-8", b"This page answers to 127.0.0.1 and localhost only.\n")
            return
        address = urlsplit(self.path)
        query = {name: values[-1] for name, values in parse_qs(address.query).items()}
        if address.path == "/":
            self._answer(200, "text/html; charset=utf-8", _PAGE.read_bytes())
        elif address.path == "/status.json":
            self._answer(200, "application/json", json.dumps(self._page.status()).encode())
        elif address.path in ("/frame.jpg", "/stream.mjpg"):
            self._show(address.path, query)
        else:
            self._answer(404, "text/plain; charset=utf-8", b"There are /, /status.json, /frame.jpg and /stream.mjpg.\n")

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 (the base class's name)
        """Suppresses HTTP request logging."""

    def _show(self, path: str, query: dict[str, str]) -> None:
        camera, after = query.get("camera"), query.get("after", "0")
        if camera is not None and camera not in (FOLLOW, TOP, BOTH):
            self._answer(400, "text/plain; charset=utf-8", b"camera has to be follow, top or both\n")
            return
        if not (after.isascii() and after.isdigit() and len(after) < 16):
            self._answer(400, "text/plain; charset=utf-8", b"after has to be the number of a picture\n")
            return
        if not self._page.viewers.acquire(blocking=False):
            self._answer(503, "text/plain; charset=utf-8", b"Too many look already.\n")
            return
        try:
            if camera is not None:
                self._page.frames.camera = camera
            if path == "/stream.mjpg":
                self._stream()
            else:
                self._frame(int(after))
        finally:
            self._page.viewers.release()

    def _frame(self, after: int) -> None:
        number, jpeg = self._page.frames.next_after(after, self._page.patience_s)
        if number == after or not jpeg:
            self._answer(204, "image/jpeg", b"")
        else:
            self._answer(200, "image/jpeg", jpeg, {"X-Frame": str(number)})

    def _stream(self) -> None:
        self.close_connection = True
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        number = 0
        while True:
            newest, jpeg = self._page.frames.next_after(number, self._page.patience_s)
            if self._page.frames.closed:
                return
            if newest == number:
                continue
            number = newest
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            self.wfile.write(head.encode() + jpeg + b"\r\n")

    def _answer(self, status: int, kind: str, body: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header(
            "Content-Security-Policy",
            "default-src 'none'; img-src 'self' blob:; connect-src 'self'; style-src 'unsafe-inline'; "
            "script-src 'unsafe-inline'; frame-ancestors 'none'",
        )
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)
