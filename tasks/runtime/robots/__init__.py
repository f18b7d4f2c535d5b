"""Robots: Scout, the walker, robots of `robot.yaml` and of MuJoCo Menagerie, and their drives.

May import: `schemas`, `tasks.runtime.episode`, `tasks.runtime.robots.robot_yaml`.
"""

__all__ = ["bases", "drives", "lookup", "robot", "scout"]
