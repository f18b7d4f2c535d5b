"""Live pictures of a run, rendered in a thread of their own and only while a viewer waits for one."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import copy
import io
import sys
import threading
import time
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from ..episode.physics import raw_physics
from ..rendering.drawing import awake, work_out_places
from ..rendering.view_culling import MODEL_BORROWED
from .video_settings import VideoSettings
from .view_renderer import RAYS, ViewRenderer

INTERVAL_S = 0.2
"""Wall-clock time between two pictures, at least."""
_JPEG_QUALITY = 82
_PATIENCE_S = 1.0
"""Time limit for finishing the last picture."""


@dataclass(frozen=True)
class _State:
    model: mujoco.MjModel
    camera: str | None
    time_s: float
    places: list[NDArray[np.float64]]


class LiveFrames:
    """Hands states from the run's thread to a rendering thread, and its pictures to waiting viewers.

    The run's thread only reads a flag while no viewer waits, and copies positions when one does.
    """

    def __init__(self, backend: str | None, settings: VideoSettings) -> None:
        """Prepares; nothing is rendered before a viewer waits.

        Args:
            backend: `egl` or `osmesa`; None or `rays`: rays.
            settings: Camera and size.
        """
        self.camera = settings.camera
        """`follow`, `top`, `both`, or the name of a camera of the model."""
        self.problem = ""
        """Why there are no pictures; empty if there are."""
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
        """Copies the physics' positions if a viewer waits for a picture and one is due."""
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
        """Waits for a picture.

        Args:
            number: Of the picture that the caller has; 0: none.
            timeout_s: How long to wait.

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
        """Releases all waiting viewers and ends the rendering."""
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
    """Draws states of one model, on a copy of it."""

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
