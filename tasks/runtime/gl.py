"""Which OpenGL a run's process uses.

MuJoCo and dm_control choose their OpenGL when they are imported, from `MUJOCO_GL`. Runs are forked from
a process that imported both without any, so a run that renders makes them choose again.
"""

import importlib
import os

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
