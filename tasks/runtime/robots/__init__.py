"""Robots: Scout, the walker, robots of `robot.yaml` and of MuJoCo Menagerie, and their drives.

May import: `schemas`, `tasks.runtime.episode`.
"""

__all__ = ["bases", "lookup", "mapped_model", "robot", "scout"]
