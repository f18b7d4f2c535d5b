"""Records a camera's pictures when a job asks for them: rendering costs more than all the rest of a run."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import io
import math
import sys
import traceback
from typing import Any

import mujoco
from PIL import Image as PillowImage

from ..episode.physics import raw_physics
from ..episode.results import Findings, Observer
from ..recording import messages as ros
from ..recording.camera_frames import CAMERA_FRAME, OPTICAL_FRAME, TO_OPTICAL, Mount, camera_info, find_mount, frames_of
from ..recording.messages import CompressedImage
from ..recording.recording import Recorder
from ..rendering.cameras import Image
from ..rendering.views import CameraNameError
from .video import RAYS, ViewRenderer
from .video_settings import RECORDED_CAMERA_VARIABLE, CameraRecording, VideoSettings

TOPIC = "/camera/image_raw/compressed"
INFO_TOPIC = "/camera/camera_info"
_SIZE = (320, 240)
_JPEG_QUALITY = 80
_FRONT = "front"


class CameraRecorder(Observer):
    """Observer that records camera pictures (JPEG, 320 x 240) as ROS messages.

    `sensor_msgs/CameraInfo` on `/camera/camera_info`, with the same stamps, says how to project into them, and `/tf` or
    `/tf_static` where the camera is: `camera_link`, and `camera_optical_frame`, which is the frame of both messages.

    Pictures that cannot be made do not fail the run: the reason goes to the error log and, as `camera_error`, to the
    result.
    """

    def __init__(self, recorder: Recorder, settings: CameraRecording, backend: str | None) -> None:
        """Prepares; nothing is rendered before the first look.

        Args:
            recorder: Where the pictures go.
            settings: Which camera, how often.
            backend: `egl` or `osmesa` (what `MUJOCO_GL` says), or `rays`; None takes rays.
        """
        self._recorder, self._settings, self._backend = recorder, settings, backend or RAYS
        self._renderer: ViewRenderer | None = None
        self._error: str | None = None

    def watch(self, environment: Any, time_s: float) -> None:
        """Records a picture.

        Raises:
            RecordingError: The recording cannot be written.
        """
        try:
            renderer, data = self._aimed(environment)
            picture = _jpeg(renderer.picture(data))
            view = renderer.look(data, self._scene)
            mount = find_mount(renderer.model, view, self._scene, frames_of(environment, renderer.model))
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
        header = ros.Header(ros.Time.from_seconds(time_s), OPTICAL_FRAME)
        self._publish_frames(mount, header.stamp, time_s)
        self._recorder.write(TOPIC, CompressedImage(header, "jpeg", picture), time_s)
        info = camera_info(header, self._scene, _SIZE)
        if info is not None:
            self._recorder.write(INFO_TOPIC, info, time_s)
        # From now rather than from the time it was due: control steps may be longer than the interval.
        self.next_time_s = time_s + 1.0 / self._settings.rate_hz

    def close(self, ended_by: str | None) -> Findings:
        """Frees the renderer; returns the reason if no pictures were recorded."""
        del ended_by
        if self._renderer is not None:
            self._renderer.close()
        return Findings({"camera_error": self._error} if self._error else {})

    def _aimed(self, environment: Any) -> tuple[ViewRenderer, mujoco.MjData]:
        """Returns the renderer for the environment's current model, and the state to render."""
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


def _default_camera(model: mujoco.MjModel) -> str | None:
    """Chooses the robot's front camera, else the model's first camera that has a name."""
    names = [model.camera(camera).name for camera in range(model.ncam)]
    ahead = [name for name in names if name.rpartition("/")[2] == _FRONT]
    return next((name for name in (*ahead, *names) if name), None)
