"""Chooses the OpenGL backend of a run's process.

MuJoCo and dm_control choose their OpenGL when they are imported, from `MUJOCO_GL`. Runs are forked from
a process that imported both without any, so a run that renders makes them choose again.
"""

import importlib
import os
from typing import Any

DISABLED = "disable"


def follow_environment() -> None:
    """Makes MuJoCo and dm_control use what `MUJOCO_GL` asks for now; nothing to do without OpenGL.

    Raises:
        Exception: The OpenGL asked for is not there; the kind depends on what is missing.
    """
    if os.environ.get("MUJOCO_GL", DISABLED) == DISABLED:
        return
    for name in ("mujoco.rendering.classic.gl_context", "dm_control._render"):
        importlib.reload(importlib.import_module(name))


def make_context(width: int, height: int, backend: str | None = None) -> Any:
    """Makes an OpenGL context without touching what MuJoCo and dm_control have chosen.

    Args:
        width: Pixels at most.
        height: Pixels at most.
        backend: `egl`, `osmesa` or `glfw`, where `MUJOCO_GL` does not say.

    Returns:
        An object of MuJoCo's with `make_current()` and `free()`.

    Raises:
        Exception: OpenGL does not work here; the kind depends on the driver.
    """
    chosen = os.environ.get("MUJOCO_GL", DISABLED).lower()
    name = chosen if chosen in ("egl", "osmesa", "glfw") else backend or "egl"
    return importlib.import_module(f"mujoco.{name}").GLContext(width, height)
