"""Robot application for a legged robot: runs the agent of `scout` with a walking robot.

`indoor-navigation` puts the walker into the world of a job with this robot application. Its gait takes the same
velocity commands as wheels, so that the same agent plans for it, with the walker's radius and speeds.
"""

from .scout.agent import make_agent

__all__ = ["make_agent"]
