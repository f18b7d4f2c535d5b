"""Camera images of a run, for its recording and for ROS nodes that subscribe to them.

Rendering costs more than all the rest of a run.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import io
import math
import sys
import traceback
from collections.abc import Callable
from typing import Any, NamedTuple

import mujoco
import numpy as np
from PIL import Image as PillowImage

from ....schemas.runs.ros_options import RosOptions
from ..episode.physics import raw_physics
from ..episode.run_results import Findings, Observer
from ..recording import messages as ros
from ..recording.camera_frames import CAMERA_FRAME, OPTICAL_FRAME, TO_OPTICAL, Mount, camera_info, find_mount, frames_of
from ..recording.messages import CameraInfo, CompressedImage
from ..recording.recording import Recorder
from ..rendering.cameras import Depths, Image
from ..rendering.views import CameraNameError
from .video import RAYS, ViewRenderer
from .video_settings import RECORDED_CAMERA_VARIABLE, CameraRecording, VideoSettings

TOPIC = "/camera/image_raw/compressed"
INFO_TOPIC = "/camera/camera_info"
RAW_TOPIC = "/camera/image_raw"
DEPTH_TOPIC = "/camera/depth/image_raw"
DEPTH_INFO_TOPIC = "/camera/depth/camera_info"
POINTS_TOPIC = "/camera/depth/points"
_COLOUR = (TOPIC, RAW_TOPIC)
_DEPTH = (DEPTH_TOPIC, POINTS_TOPIC)
_TOPICS = (*_COLOUR, INFO_TOPIC, *_DEPTH, DEPTH_INFO_TOPIC)
_SIZE = (320, 240)
_JPEG_QUALITY = 80
_FRONT = "front"
_MOST_MM = 0xFFFF
"""Largest depth in mm that an image of encoding `16UC1` can have."""


class _Sight(NamedTuple):
    """Image and depths (m) that a camera sees, each missing if it is not needed, and the camera's pose."""

    picture: Image | None
    depths_m: Depths | None
    mount: Mount


class CameraRecorder(Observer):
    """Observer that records camera images (JPEG, 320 x 240) as ROS messages.

    `sensor_msgs/CameraInfo` on `/camera/camera_info`, with the same stamps, has the projection, and `/tf` or
    `/tf_static` the camera's pose: `camera_link`, and `camera_optical_frame`, which is the frame of both messages.

    ROS nodes that subscribe to them get the same messages, and raw images, depths and points of the same camera, which
    are not recorded: a second of them is as large as minutes of all the rest.

    If images cannot be rendered, the run does not fail: the reason is written to the error log, and as `camera_error`
    to the result.
    """

    def __init__(
        self,
        recorder: Recorder,
        settings: CameraRecording,
        backend: str | None,
        options: Callable[[], RosOptions] = RosOptions,
    ) -> None:
        """Prepares the recorder of an environment's camera; nothing is rendered before the first call of `watch`.

        Args:
            recorder: Recorder that gets the images; it knows which topics nodes subscribe to.
            settings: Name and rate of the camera.
            backend: `egl` or `osmesa` (the value of `MUJOCO_GL`), or `rays`; None means `rays`.
            options: Function that returns the options of the ROS bridge, which are known once it looks for nodes.
        """
        self._recorder, self._settings, self._backend = recorder, settings, backend or RAYS
        self._options = options
        self._renderer: ViewRenderer | None = None
        self._error: str | None = None

    def watch(self, environment: Any, time_s: float) -> None:
        """Records a picture, and publishes the camera topics that nodes subscribe to.

        If no picture can be made, that is written to standard error, and the camera is not tried again.

        Raises:
            RecordingError: The recording cannot be written.
        """
        options = self._options()
        # From now rather than from the time it was due: control steps may be longer than the interval.
        self.next_time_s = time_s + 1.0 / (self._settings.rate_hz or options.camera_rate_hz)
        wanted = {topic for topic in _TOPICS if self._recorder.is_heard(topic)}
        if self._settings.is_recorded:
            wanted |= {TOPIC, INFO_TOPIC}
        if not wanted:
            return
        try:
            sight = self._look(environment, wanted)
        except CameraNameError as error:
            self.next_time_s, self._error = math.inf, str(error)
            sys.stderr.write(f"No camera in the recording: {error}.\n")
            return
        except Exception:
            self.next_time_s = math.inf
            self._error = traceback.format_exc(limit=0).strip().splitlines()[-1]
            sys.stderr.write(f"No camera in the recording: it could not be made with {self._backend}.\n")
            traceback.print_exc()
            return
        self._publish(sight, wanted, options.depth_encoding, time_s)

    def _publish(self, sight: _Sight, wanted: set[str], depth_encoding: str, time_s: float) -> None:
        header = ros.Header(ros.Time.from_seconds(time_s), OPTICAL_FRAME)
        self._publish_frames(sight.mount, header.stamp, time_s)
        if sight.picture is not None:
            if TOPIC in wanted:
                self._put(TOPIC, CompressedImage(header, "jpeg", _jpeg(sight.picture)), time_s)
            self._recorder.tell(RAW_TOPIC, ros.Image(header, "rgb8", sight.picture))
        if sight.depths_m is not None:
            self._recorder.tell(DEPTH_TOPIC, _depth_image(header, sight.depths_m, depth_encoding))
        info = camera_info(header, self._scene, _SIZE)
        if info is None:
            return
        if INFO_TOPIC in wanted:
            self._put(INFO_TOPIC, info, time_s)
        self._recorder.tell(DEPTH_INFO_TOPIC, info)
        if sight.depths_m is not None and POINTS_TOPIC in wanted:
            self._recorder.tell(POINTS_TOPIC, ros.PointCloud2(header, _points(sight.depths_m, info)))

    def _put(self, topic: str, message: Any, time_s: float) -> None:
        if self._settings.is_recorded:
            self._recorder.write(topic, message, time_s)
        else:
            self._recorder.tell(topic, message)

    def _look(self, environment: Any, wanted: set[str]) -> _Sight:
        renderer, data = self._aimed(environment)
        picture = renderer.picture(data) if wanted.intersection(_COLOUR) else None
        depths_m = renderer.depths(data) if wanted.intersection(_DEPTH) else None
        view = renderer.look(data, self._scene)
        mount = find_mount(renderer.model, view, self._scene, frames_of(environment, renderer.model))
        return _Sight(picture, depths_m, mount)

    def close(self, ended_by: str | None) -> Findings:
        """Frees the renderer; returns the reason if pictures could not be recorded, and no findings otherwise."""
        del ended_by
        if self._renderer is not None:
            self._renderer.close()
        return Findings({"camera_error": self._error} if self._error else {})

    def _aimed(self, environment: Any) -> tuple[ViewRenderer, mujoco.MjData]:
        """Returns the renderer for the environment's current model, made anew if that is, and the state to render."""
        model, data = raw_physics(environment.physics)
        if self._renderer is None or model is not self._renderer.model:
            if self._renderer is not None:
                self._renderer.close()
            asked = self._settings
            camera = asked.camera or _default_camera(model)
            settings = VideoSettings(camera, _SIZE, appearance=asked.appearance, seed=asked.seed)
            self._renderer = ViewRenderer(model, settings, self._backend, said_by=RECORDED_CAMERA_VARIABLE)
            # Without a renderer: only to learn where the camera stands, and how it projects.
            self._scene = mujoco.MjvScene(model, maxgeom=1)
        return self._renderer, data

    def _publish_frames(self, mount: Mount, stamp: ros.Time, time_s: float) -> None:
        optical = ros.TransformStamped(ros.Header(stamp, CAMERA_FRAME), OPTICAL_FRAME, TO_OPTICAL)
        own = ros.TransformStamped(ros.Header(stamp, mount.parent), CAMERA_FRAME, mount.transform)
        if mount.is_fixed:
            self._recorder.add_static_transforms((own, optical), time_s)
        else:
            self._recorder.add_static_transforms((optical,), time_s)
            self._recorder.write("/tf", ros.TFMessage((own,)), time_s)


def _jpeg(pixels: Image) -> bytes:
    picture = io.BytesIO()
    PillowImage.fromarray(pixels).save(picture, "JPEG", quality=_JPEG_QUALITY)
    return picture.getvalue()


def _depth_image(header: ros.Header, depths_m: Depths, encoding: str) -> ros.Image:
    """Returns a ROS depth image message as in REP 118: metres as floats, or millimetres as integers, 0 if too far."""
    if encoding == "32FC1":
        return ros.Image(header, encoding, depths_m)
    millimetres = np.rint(1000.0 * depths_m)
    return ros.Image(header, encoding, np.where(millimetres <= _MOST_MM, millimetres, 0).astype(np.uint16))


def _points(depths_m: Depths, info: CameraInfo) -> Depths:
    """Computes the points of a depth image in the optical frame in metres, shape (height, width, 3), NaN at the sky."""
    height, width = depths_m.shape
    seen_m = np.where(np.isfinite(depths_m), depths_m, np.float32(np.nan))
    right = (np.arange(width, dtype=np.float32) - np.float32(info.cx)) / np.float32(info.fx)
    down = (np.arange(height, dtype=np.float32) - np.float32(info.cy)) / np.float32(info.fy)
    return np.stack((seen_m * right, seen_m * down[:, None], seen_m), axis=2)


def _default_camera(model: mujoco.MjModel) -> str | None:
    """Returns the name of the robot's front camera, else of the model's first camera that has a name.

    Returns `None` if there is none.
    """
    names = [model.camera(camera).name for camera in range(model.ncam)]
    ahead = [name for name in names if name.rpartition("/")[2] == _FRONT]
    return next((name for name in (*ahead, *names) if name), None)
