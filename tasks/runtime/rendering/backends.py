"""Rendering backends (EGL, OSMesa, ray casting) that work on this machine, found by trying them."""

import os
import subprocess
import sys
from dataclasses import dataclass
from functools import lru_cache

_TIMEOUT_S = 60.0
_PACKAGES = {
    "egl": ("libegl1", "libegl-mesa0", "libgl1-mesa-dri"),
    "osmesa": ("libosmesa6",),
    "rays": (),
}
_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><geom size='1' rgba='1 0 0 1'/><light pos='0 0 5'/></worldbody></mujoco>")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer = mujoco.Renderer(model, 48, 64)
renderer.update_scene(data)
picture = renderer.render()
renderer.close()
assert picture[24, 32, 0] > picture[24, 32, 2], "it draws the wrong colours"
"""


@dataclass(frozen=True)
class VideoBackend:
    """A way of rendering videos (EGL, OSMesa or ray casting), and whether it works on this machine."""

    name: str
    """Name of the rendering backend: `egl`, `osmesa` or `rays`."""

    works: bool
    """Whether a test image could be rendered on this machine."""

    problem: str
    """Reason why the rendering backend does not work here; empty if it does."""

    packages: tuple[str, ...]
    """Debian packages that the rendering backend needs."""


def available_video_backends() -> list[VideoBackend]:
    """Tries every way of rendering videos, best first; takes a second or two the first time.

    Returns:
        EGL (hardware, or Mesa's software), OSMesa, and casting rays, which always works but shows flat
        colours at half the size.
    """
    return [_probe("egl"), _probe("osmesa"), VideoBackend("rays", works=True, problem="", packages=())]


def best_video_backend() -> str:
    """Returns the name of the best way of rendering that works on this machine."""
    return next(name for name in _PACKAGES if name == "rays" or _probe(name).works)


@lru_cache
def _probe(name: str) -> VideoBackend:
    """Renders a test image in a process of its own, as a bad graphics driver may crash it; returns whether it works.

    Found out once: what is installed seldom changes while a process runs.
    """
    environment = {key: value for key, value in os.environ.items() if key != "PYOPENGL_PLATFORM"}
    try:
        attempt = subprocess.run(
            [sys.executable, "-P", "-c", _PROBE],
            env={**environment, "MUJOCO_GL": name},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return VideoBackend(name, works=False, problem=f"no picture within {_TIMEOUT_S:g} s", packages=_PACKAGES[name])
    if attempt.returncode == 0:
        return VideoBackend(name, works=True, problem="", packages=_PACKAGES[name])
    lines = attempt.stderr.strip().splitlines()
    problem = lines[-1] if lines else f"the attempt ended with exit code {attempt.returncode}"
    return VideoBackend(name, works=False, problem=problem, packages=_PACKAGES[name])
