"""Videos of runs: images of a camera view, encoded as MP4 during the run."""

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

from ....schemas.worlds.appearance import appearance_named
from ...files.untrusted_files import unfinished_of
from ..episode.physics import raw_physics
from ..episode.run_results import Findings, Observer
from ..episode.run_timeline import FilmTimes
from ..rendering.cameras import Camera, Depths, GlCamera, Image
from ..rendering.ray_camera import RayCamera
from ..rendering.views import CameraNameError, View, choose_views
from .video_settings import (
    CAMERA_VARIABLE,
    DEFAULT_SIZE,
    DEFAULTS,
    NO_PHYSICS,
    POSTER_FILE,
    VIDEO_FILE,
    VideoSettings,
)


class VideoWriter:
    """Writer of an H.264 video file, which is renamed to its path when it is complete."""

    def __init__(self, path: Path, size: tuple[int, int], rate_hz: int) -> None:
        """Opens a video file (MP4 with H.264) under a temporary name.

        Args:
            path: Path of the complete file.
            size: Width and height in pixels, both even.
            rate_hz: Frames per second.

        Raises:
            OSError: The file cannot be written.
        """
        self.frames = 0
        self.rate_hz = rate_hz
        self._path = path
        self._unfinished = unfinished_of(path)
        self._container = av.open(str(self._unfinished), "w", format="mp4", options={"movflags": "faststart"})
        self._stream = self._container.add_stream("libx264", rate=rate_hz)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        # One thread: as many runs as cores are usually going on at a time.
        self._stream.options = {"preset": "veryfast", "threads": "1"}
        self._stream.codec_context.time_base = Fraction(1, rate_hz)

    def add(self, picture: Image) -> None:
        """Adds the next frame to the video."""
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts = self.frames
        frame.time_base = Fraction(1, self.rate_hz)
        self._container.mux(self._stream.encode(frame))
        self.frames += 1

    def close(self) -> None:
        """Finishes the video file, and renames it to its path."""
        self._container.mux(self._stream.encode(None))
        self._container.close()
        self._unfinished.replace(self._path)

    def abandon(self) -> None:
        """Closes and deletes the unfinished video file."""
        self._container.close()
        self._unfinished.unlink(missing_ok=True)


RAYS = "rays"
"""Name of the rendering backend that needs no OpenGL (ray casting)."""

_RAY_SIZE = (320, 240)
_INSET_SHARE = 0.36
_INSET_MARGIN_SHARE = 0.02
_INSET_EVERY_S = 0.3
"""Simulated seconds between two renderings of the inset from above: a robot moves by a few pixels in it, and it costs
the most.
"""
_FRAME = 245


class ViewRenderer:
    """Renderer of the frames of one video, and of depths, from a camera view; to be closed at the end."""

    def __init__(
        self,
        model: mujoco.MjModel,
        settings: VideoSettings,
        backend: str,
        environment_camera: str | None = None,
        said_by: str = CAMERA_VARIABLE,
    ) -> None:
        """Creates the renderer of a model's views, with its OpenGL context if it needs one.

        Args:
            model: The MuJoCo model.
            settings: Camera and size of the video.
            backend: `egl`, `osmesa` or `rays` (ray casting without OpenGL).
            environment_camera: Camera name from the environment's `video_camera`, used if the settings name none.
            said_by: Variable or option that names the camera of the settings, for the error message.

        Raises:
            CameraNameError: The model has no camera of that name.
            Exception: OpenGL does not work on this machine; the class depends on the driver.
        """
        self.size = settings.size or (_RAY_SIZE if backend == RAYS else DEFAULT_SIZE)
        width, height = self.size
        self.model = model
        self.aim(
            settings.camera or environment_camera,
            said_by if settings.camera else "the environment's video_camera",
        )
        self._camera: Camera
        if backend == RAYS:
            self._camera = RayCamera(model, width, height)
        else:
            lit = settings.appearance and appearance_named(settings.appearance, settings.seed)
            self._camera = GlCamera(model, width, height, backend, lit or None)

    def aim(self, name: str | None, said_by: str) -> None:
        """Switches the renderer to another camera of its model.

        Args:
            name: Name of the view; see `views.choose_views`.
            said_by: Source of the name, for the error message.

        Raises:
            CameraNameError: The model has no camera of that name.
        """
        width, height = self.size
        self._view, self._small_view = choose_views(self.model, name, said_by, width / height)
        self._small: Image | None = None
        self._small_time_s = 0.0

    def picture(self, data: mujoco.MjData) -> Image:
        """Renders the picture of a state whose poses have been computed, perhaps with a small second view."""
        picture = self._camera.picture(data, self._view)
        if self._small_view is not None:
            _inset(picture, self._small_picture(data, self._small_view))
        return picture

    def depths(self, data: mujoco.MjData) -> Depths:
        """Renders the depths in the camera view of a simulation state, in metres, shape (height, width)."""
        return self._camera.depths(data, self._view)

    def look(self, data: mujoco.MjData, scene: mujoco.MjvScene) -> mujoco.MjvCamera:
        """Returns the camera for a state, and aims the scene's camera accordingly."""
        view = self._view(data)
        mujoco.mjv_updateCamera(self.model, data, view, scene)
        return view

    def _small_picture(self, data: mujoco.MjData, view: View) -> Image:
        if self._small is None or not 0 <= data.time - self._small_time_s < _INSET_EVERY_S - 1e-6:
            width, height = (round(_INSET_SHARE * number) for number in self.size)
            self._small = self._camera.picture(data, view, (width, height))
            self._small_time_s = data.time
        return self._small

    def close(self) -> None:
        """Frees the renderer's memory; no picture can be rendered afterwards."""
        self._camera.close()


def _inset(picture: Image, small: Image) -> None:
    """Puts a small image into the upper right corner of another image, in place, with a frame."""
    edge = max(1, picture.shape[0] // 240)
    margin = max(2, round(_INSET_MARGIN_SHARE * picture.shape[0]))
    height, width = small.shape[:2]
    right = picture.shape[1] - margin
    picture[margin : margin + height + 2 * edge, right - width - 2 * edge : right] = _FRAME
    picture[margin + edge : margin + edge + height, right - edge - width : right - edge] = small


POSTER_TIME_S = 2.0


class VideoWatcher(Observer):
    """Observer that records a video of the simulation at a fixed frame rate in simulated time.

    If the video cannot be made, the run does not fail: the reason is written to the error log, and as `video_error` to
    the result.
    """

    def __init__(self, output_dir: Path, backend: str | None, settings: VideoSettings = DEFAULTS) -> None:
        """Prepares the recorder of a run's video and poster; no file is opened before the first frame.

        Args:
            output_dir: Folder for `video.mp4` and `poster.png`.
            backend: `egl` or `osmesa` (the value of `MUJOCO_GL`), or `rays`; None means `rays`.
            settings: Camera, size and rate.
        """
        self._begins_s = 0.0
        self._output_dir = output_dir
        self._backend = backend or RAYS
        self._settings = settings
        self._error: str | None = None
        self._model: mujoco.MjModel | None = None
        self._renderer: ViewRenderer | None = None
        self._writer: VideoWriter | None = None
        self._poster: Image | None = None
        self._is_finished = False

    def watch(self, environment: Any, time_s: float) -> None:
        """Renders a frame of the video, and repeats it for frames that a long control step skipped.

        An error ends the video, and not the run; a wrong camera name is told on standard error.
        """
        try:
            picture = self._picture(environment)
            if self._writer is None:
                size = picture.shape[1], picture.shape[0]
                self._writer = VideoWriter(self._output_dir / VIDEO_FILE, size, self._settings.rate_hz)
            # The video begins with the run, also when the physics' own time does not begin at 0.
            while self.next_time_s <= time_s + 5e-7:
                self._writer.add(picture)
                self.next_time_s = self._begins_s + self._writer.frames / self._writer.rate_hz
            if self._poster is None or time_s <= self._begins_s + POSTER_TIME_S:
                self._poster = picture
        except CameraNameError as error:
            self.next_time_s, self._error = float("inf"), str(error)
            sys.stderr.write(f"No video: {error}.\n")
            self._abandon()
        except Exception:
            self._give_up()

    def close(self, ended_by: str | None) -> Findings:
        """Finishes the video file and its poster, the picture that stands for it.

        Args:
            ended_by: Cause of the run's end; None if it failed. The video is finished in any case.

        Returns:
            Remarks for the result: `video_backend`, or `video_error` with the reason there is no video.
        """
        try:
            if self._writer is not None and self._poster is not None:
                self._writer.close()
                self._is_finished = True
                PillowImage.fromarray(self._poster).save(self._output_dir / POSTER_FILE)
        except Exception:
            self._give_up()
        if self._renderer is not None:
            self._renderer.close()
        if self._error is None and self._writer is None:
            if ended_by is None:
                return Findings()  # there may have been no environment, whose failure is what counts
            self._error = NO_PHYSICS
            sys.stderr.write(f"No video: {self._error}.\n")
        if self._error:
            return Findings({"video_error": self._error})
        return Findings({"video_backend": self._backend})

    def times(self) -> dict[str, FilmTimes]:
        """Returns the simulated times that the finished video shows, by its file name; empty without one."""
        if self._writer is None or not self._is_finished:
            return {}
        times = FilmTimes(begins_s=self._begins_s, rate_hz=self._writer.rate_hz, frames=self._writer.frames)
        return {VIDEO_FILE: times}

    def restore(self, state: float, environment: Any) -> None:
        """Begins a new video at the time of a checkpoint, because the earlier one was lost with its process."""
        super().restore(state, environment)
        self._begins_s = state

    def _picture(self, environment: Any) -> Image:
        model, data = raw_physics(environment.physics)
        if self._renderer is None or model is not self._model:
            if self._renderer is not None:
                self._renderer.close()
            self._model = model
            camera = getattr(environment, "video_camera", None)
            self._renderer = ViewRenderer(model, self._settings, self._backend, camera)
        return self._renderer.picture(data)

    def _give_up(self) -> None:
        self.next_time_s = float("inf")
        self._error = traceback.format_exc(limit=0).strip().splitlines()[-1]
        sys.stderr.write(f"No video: it could not be made with {self._backend}.\n")
        traceback.print_exc()
        self._abandon()

    def _abandon(self) -> None:
        if self._writer is not None:
            self._writer.abandon()
            self._writer = None
