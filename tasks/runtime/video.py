"""The video of a run."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import sys
import traceback
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import mujoco
from PIL import Image as PillowImage

from .cameras import Camera, GlCamera, Image, RayCamera
from .physics import raw_physics
from .results import Findings

VIDEO_FILE = "video.mp4"
POSTER_FILE = "poster.png"
FRAME_RATE_HZ = 15
_SIZE = (640, 480)
_RAY_SIZE = (320, 240)
_POSTER_TIME_S = 2.0
RAYS = "rays"
"""The backend that needs no OpenGL."""


class VideoWatcher:
    """Films an environment's physics: H.264, 15 frames per simulated second.

    A video that cannot be made does not fail the run: the reason goes to the error log and, as
    `video_error`, to the result.
    """

    def __init__(self, output_dir: Path, backend: str | None) -> None:
        """Prepares a film; nothing is opened before the first frame.

        Args:
            output_dir: Where `video.mp4` and `poster.png` are written.
            backend: `egl` or `osmesa` (what `MUJOCO_GL` says), or `rays`; None films with rays.
        """
        self.next_time_s = 0.0
        self._output_dir = output_dir
        self._backend = backend or RAYS
        self._error: str | None = None
        self._model: mujoco.MjModel | None = None
        self._camera: Camera | None = None
        self._view = mujoco.MjvCamera()
        self._encoder: _Encoder | None = None
        self._poster: Image | None = None

    def watch(self, environment: Any, time_s: float) -> None:
        """Takes a frame, and the same again for frames that a long control step skipped."""
        try:
            picture = self._picture(environment)
            if self._encoder is None:
                self._encoder = _Encoder(self._output_dir / VIDEO_FILE, picture.shape[1], picture.shape[0])
            # The film begins with the run, whatever time the environment's physics begins at.
            while self.next_time_s <= time_s + 5e-7:
                self._encoder.add(picture)
                self.next_time_s = self._encoder.frames / FRAME_RATE_HZ
            if self._poster is None or time_s <= _POSTER_TIME_S:
                self._poster = picture
        except Exception:
            self._give_up()

    def close(self, ended_by: str | None) -> Findings:
        """Finishes the files.

        Args:
            ended_by: What ended the run; None when it failed. The film is finished in any case.

        Returns:
            Remarks for the result: `video_backend`, or `video_error` with the reason there is no video.
        """
        del ended_by
        try:
            if self._encoder is not None and self._poster is not None:
                self._encoder.close()
                PillowImage.fromarray(self._poster).save(self._output_dir / POSTER_FILE)
        except Exception:
            self._give_up()
        if self._camera is not None:
            self._camera.close()
        if self._error is None and self._encoder is None:
            self._error = "the environment has no `physics` to film"
            sys.stderr.write(f"No video: {self._error}.\n")
        return Findings({"video_error": self._error} if self._error else {"video_backend": self._backend})

    def _picture(self, environment: Any) -> Image:
        model, data = raw_physics(environment.physics)
        if self._camera is None or model is not self._model:
            if self._camera is not None:
                self._camera.close()
            self._model = model
            if self._backend == RAYS:
                self._camera = RayCamera(model, *_RAY_SIZE)
            else:
                self._camera = GlCamera(model, *_SIZE)
            self._view = choose_view(model, getattr(environment, "video_camera", None))
        return self._camera.picture(data, self._view)

    def _give_up(self) -> None:
        self.next_time_s = float("inf")
        self._error = traceback.format_exc(limit=0).strip().splitlines()[-1]
        sys.stderr.write(f"No video: it could not be made with {self._backend}.\n")
        traceback.print_exc()
        if self._encoder is not None:
            self._encoder.abandon()
            self._encoder = None


def choose_view(model: mujoco.MjModel, name: str | None) -> mujoco.MjvCamera:
    """Returns the camera to film with: the one named, else the model's first, else from above at an angle.

    Raises:
        ValueError: The model has no camera of that name.
    """
    view = mujoco.MjvCamera()
    if name is not None or model.ncam:
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        view.fixedcamid = 0 if name is None else mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
        if view.fixedcamid < 0:
            there = ", ".join(model.camera(i).name for i in range(model.ncam)) or "none"
            raise ValueError(f"the environment's video_camera is {name!r}, but the model's cameras are: {there}")
        return view
    mujoco.mjv_defaultFreeCamera(model, view)
    return view


class _Encoder:
    """An H.264 file that has its name only when it is complete."""

    def __init__(self, path: Path, width: int, height: int) -> None:
        self.frames = 0
        self._path = path
        self._unfinished = path.with_name(f".{path.name}.unfinished")
        self._container = av.open(str(self._unfinished), "w", format="mp4", options={"movflags": "faststart"})
        self._stream = self._container.add_stream("libx264", rate=FRAME_RATE_HZ)
        self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
        # One thread: as many runs as cores are usually going on at a time.
        self._stream.options = {"preset": "veryfast", "threads": "1"}
        self._stream.codec_context.time_base = Fraction(1, FRAME_RATE_HZ)

    def add(self, picture: Image) -> None:
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts = self.frames
        frame.time_base = Fraction(1, FRAME_RATE_HZ)
        self._container.mux(self._stream.encode(frame))
        self.frames += 1

    def close(self) -> None:
        self._container.mux(self._stream.encode(None))
        self._container.close()
        self._unfinished.replace(self._path)

    def abandon(self) -> None:
        self._container.close()
        self._unfinished.unlink(missing_ok=True)
