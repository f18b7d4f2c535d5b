"""Renders views of a model: by its camera settings, two views in one picture where both are asked for."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import mujoco

from ....schemas.worlds.appearance import appearance_named
from ..rendering.cameras import Camera, GlCamera, Image
from ..rendering.ray_camera import RayCamera
from ..rendering.views import View, choose_views
from .video_settings import CAMERA_VARIABLE, DEFAULT_SIZE, VideoSettings

RAYS = "rays"
"""The backend that needs no OpenGL."""

_RAY_SIZE = (320, 240)
_INSET_SHARE = 0.36
_INSET_MARGIN_SHARE = 0.02
_INSET_EVERY_S = 0.3
"""Interval of the view from above: a robot moves by a few pixels in it, and this view costs the most."""
_FRAME = 245


class ViewRenderer:
    """Renders the frames of one video of one model."""

    def __init__(
        self,
        model: mujoco.MjModel,
        settings: VideoSettings,
        backend: str,
        environment_camera: str | None = None,
        said_by: str = CAMERA_VARIABLE,
    ) -> None:
        """Makes a camera.

        Args:
            model: The model.
            settings: Camera and size.
            backend: `egl`, `osmesa` or `rays`.
            environment_camera: The environment's `video_camera`; the settings go before it.
            said_by: Where the camera of the settings comes from, for the error.

        Raises:
            CameraNameError: There is no such camera.
            Exception: OpenGL does not work here; the kind depends on the driver.
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
        """Renders from another camera from now on.

        Args:
            name: See `views.choose_views`.
            said_by: Where the name comes from, for the error.

        Raises:
            CameraNameError: There is no such camera.
        """
        width, height = self.size
        self._view, self._small_view = choose_views(self.model, name, said_by, width / height)
        self._small: Image | None = None
        self._small_time_s = 0.0

    def picture(self, data: mujoco.MjData) -> Image:
        """Renders the picture of a state, whose positions have to be computed already."""
        picture = self._camera.picture(data, self._view)
        if self._small_view is not None:
            _inset(picture, self._small_picture(data, self._small_view))
        return picture

    def look(self, data: mujoco.MjData, scene: mujoco.MjvScene) -> mujoco.MjvCamera:
        """Returns the view of a state, and points the scene's camera along it."""
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
        """Frees the driver's memory."""
        self._camera.close()


def _inset(picture: Image, small: Image) -> None:
    """Puts a small picture into the upper right corner, in a frame."""
    edge = max(1, picture.shape[0] // 240)
    margin = max(2, round(_INSET_MARGIN_SHARE * picture.shape[0]))
    height, width = small.shape[:2]
    right = picture.shape[1] - margin
    picture[margin : margin + height + 2 * edge, right - width - 2 * edge : right] = _FRAME
    picture[margin + edge : margin + edge + height, right - edge - width : right - edge] = small
