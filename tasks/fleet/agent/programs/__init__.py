# pyright: reportUnsupportedDunderAll=false
"""Processes on the robot: the child, scripts, the application; their rights, their sandbox, and what they leave behind.

May import: `tasks.fleet.agent`, `tasks.fleet.agent.child`.
"""

__all__ = ["application", "launching", "leftovers", "notify", "sandbox", "work"]
