"""The built-in simulation application `indoor-navigation`: a furnished world with a robot in it.

May import: `schemas`, `tasks.runtime.episode`, `tasks.runtime.recording`, `tasks.runtime.rendering`,
`tasks.runtime.robots`.
"""

from .environment import make_environment as make_environment

__all__ = ["environment", "lidar", "make_environment", "occupancy_map"]
