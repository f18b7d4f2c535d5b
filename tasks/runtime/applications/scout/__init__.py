"""The built-in robot application `scout`: visits every room of a world, then stops.

May import: `schemas`, `tasks.runtime.applications.indoor_navigation`, `tasks.runtime.episode`,
`tasks.runtime.recording`, `tasks.runtime.robots`.
"""

from .agent import make_agent as make_agent

__all__ = ["agent", "make_agent"]
