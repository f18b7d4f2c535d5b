"""Records the video of a run while it runs."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import sys
import traceback
from pathlib import Path
from typing import Any

import mujoco
from PIL import Image as PillowImage

from ..episode.physics import raw_physics
from ..episode.results import Findings, Observer
from ..rendering.cameras import Image
from ..rendering.views import CameraNameError
from .encoder import VideoWriter
from .video_files import NO_PHYSICS, POSTER_FILE, VIDEO_FILE
from .video_settings import DEFAULTS, VideoSettings
from .view_renderer import RAYS, ViewRenderer

POSTER_TIME_S = 2.0


class VideoWatcher(Observer):
    """Records a video of an environment's physics, at a fixed number of frames per simulated second.

    A video that cannot be made does not fail the run: the reason goes to the error log and, as
    `video_error`, to the result.
    """

    def __init__(self, output_dir: Path, backend: str | None, settings: VideoSettings = DEFAULTS) -> None:
        """Prepares a video; nothing is opened before the first frame.

        Args:
            output_dir: Where `video.mp4` and `poster.png` are written.
            backend: `egl` or `osmesa` (what `MUJOCO_GL` says), or `rays`; None renders with rays.
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

    def watch(self, environment: Any, time_s: float) -> None:
        """Takes a frame, and the same again for frames that a long control step skipped."""
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
        """Finishes the files.

        Args:
            ended_by: What ended the run; None when it failed. The video is finished in any case.

        Returns:
            Remarks for the result: `video_backend`, or `video_error` with the reason there is no video.
        """
        try:
            if self._writer is not None and self._poster is not None:
                self._writer.close()
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
        return Findings(
            {"video_backend": self._backend} | ({"video_begins_s": self._begins_s} if self._begins_s else {})
        )

    def restore(self, state: float, environment: Any) -> None:
        """Begins a new video where a run is continued: the earlier one was lost with its process."""
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
