"""Robot application `scout`: visits every room of a world, then stops."""

from .agent import make_agent as make_agent

__all__ = ["make_agent"]
