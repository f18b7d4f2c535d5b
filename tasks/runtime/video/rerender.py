"""Program that renders the videos of a run from its state log, after a run that failed.

`python -P -m prefect_robomaker.tasks.runtime.video.rerender REQUEST`, where REQUEST is a `VideoRequest` as JSON. The
clip of the last seconds is rendered first, as it is most useful if time runs out.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
import os
import shutil
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image as PillowImage

from ..episode.run_timeline import FilmTimes, add_videos
from ..limits.processes import die_with_parent
from ..rendering.cameras import Image
from ..rendering.views import CameraNameError, awake, work_out_places
from ..states.state_log import Segment, StateLog
from .video import VideoWriter, ViewRenderer
from .video_settings import CLIP_FILE, POSTER_FILE, VIDEO_FILE, VideoRequest, VideoSettings

CLIP_S = 10.0
_NICENESS = 15
"""Niceness of the process: rendering gets a thirtieth of a processor that a simulation uses, and all of an idle one."""
_TOLERANCE_S = 5e-7
"""Tolerance in seconds for rounding errors in sums of time steps, as in the simulation loop."""


def write_videos(request: VideoRequest) -> None:
    """Renders `last-10s.mp4`, `poster.png`, and if asked for `video.mp4`, from a state log.

    Replaces earlier files and links of these names, and notes the videos' times in the run's timeline.

    Raises:
        StateLogError: The run has no state log.
        ValueError: No state was noted, or there is no such camera.
        Exception: OpenGL does not work here, or the files cannot be written.
    """
    log = StateLog.open(request.log_dir)
    if not log.frames:
        raise ValueError("no state was noted")
    clip, video = request.output_dir / CLIP_FILE, request.output_dir / VIDEO_FILE
    is_short = log.end_s <= CLIP_S
    # For a short run the clip is the whole video.
    last, times = write_video(log, clip, request.settings, request.backend, begin_s=max(0.0, log.end_s - CLIP_S))
    shown = {CLIP_FILE: times}
    poster = request.output_dir / POSTER_FILE
    for path in (poster, video) if request.whole_video else (poster,):
        path.unlink(missing_ok=True)  # programs may have left a link there
    PillowImage.fromarray(last).save(poster)
    if request.whole_video and is_short:
        shutil.copyfile(clip, video)
        shown[VIDEO_FILE] = times
    elif request.whole_video:
        _, shown[VIDEO_FILE] = write_video(log, video, request.settings, request.backend)
    add_videos(shown, request.output_dir)


def write_video(
    log: StateLog, path: Path, settings: VideoSettings, backend: str, begin_s: float = 0.0
) -> tuple[Image, FilmTimes]:
    """Renders one video from a state log, from a start time to the end.

    Nothing is left of the video after an error.

    Args:
        log: State log of the run.
        path: Path of the video.
        settings: Camera, size and rate.
        backend: `egl`, `osmesa` or `rays`.
        begin_s: Simulated time of the first image.

    Returns:
        The last picture, and the simulated times that the video shows.

    Raises:
        Exception: OpenGL does not work here, or the file cannot be written.
    """
    writer: VideoWriter | None = None
    picture: Image | None = None
    begin = _first_frame(log, settings, begin_s)
    try:
        for picture in _pictures(log, settings, backend, begin):
            if writer is None:
                writer = VideoWriter(path, (picture.shape[1], picture.shape[0]), settings.rate_hz)
            writer.add(picture)
        assert writer is not None
        assert picture is not None
        writer.close()
    except BaseException:
        if writer is not None:
            writer.abandon()
        raise
    return picture, FilmTimes(begins_s=begin / settings.rate_hz, rate_hz=settings.rate_hz, frames=writer.frames)


def _first_frame(log: StateLog, settings: VideoSettings, begin_s: float) -> int:
    """Returns the number of the first frame, counted from simulated time 0; at the latest that of the last state."""
    return min(math.ceil(begin_s * settings.rate_hz - 1e-6), math.floor(log.end_s * settings.rate_hz + 1e-6))


def _pictures(log: StateLog, settings: VideoSettings, backend: str, begin: int) -> Iterator[Image]:
    """Yields the images of the video's frames from the frame number `begin` on; at least that of the last state."""
    for segment in log.segments:
        last = math.floor((segment.times[-1] + _TOLERANCE_S) * settings.rate_hz)
        if last >= begin:
            yield from _pictures_of(segment, log.camera, settings, backend, begin, last)
            begin = last + 1


def _pictures_of(
    segment: Segment, camera: str | None, settings: VideoSettings, backend: str, begin: int, last: int
) -> Iterator[Image]:
    model = awake(mujoco.MjModel.from_binary_path(str(segment.model_path)))
    data = mujoco.MjData(model)
    # Each frame shows the first state that is not before it, as it does when the video is recorded during the run.
    due_s = np.arange(begin, last + 1) / settings.rate_hz - _TOLERANCE_S
    renderer = ViewRenderer(model, settings, backend, camera)
    try:
        shown, picture = -1, None
        for index in np.searchsorted(segment.times, due_s).tolist():
            if picture is None or index != shown:
                segment.set_state(data, index)
                work_out_places(model, data)
                shown, picture = index, renderer.picture(data)
            yield picture
    finally:
        renderer.close()


def main() -> int:
    """Entry point of a child process that renders the videos requested, as JSON, on its command line.

    Returns the exit code: 1 if rendering failed, with the reason on standard error, or if the parent has died, else 0.
    """
    request = VideoRequest.model_validate_json(sys.argv[1])
    die_with_parent()
    if os.getppid() != request.parent_pid:
        return 1
    os.nice(_NICENESS)  # runs that are still going on come first
    try:
        write_videos(request)
    except CameraNameError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except Exception as error:
        traceback.print_exc()
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    # Without the interpreter's clean-up, in which OpenGL's libraries may complain.
    os._exit(code)
