"""The built-in legged robot application: Scout's program for a robot that walks.

`indoor-navigation` puts the walker into the world of a job whose robot application this is. Its gait takes the same
commands as wheels do, so that the same program plans for it, with its radius and its speeds.
"""

from .scout.agent import make_agent

__all__ = ["make_agent"]
