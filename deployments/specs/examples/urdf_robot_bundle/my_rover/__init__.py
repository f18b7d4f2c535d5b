"""A robot from a URDF, driven by the program that drives Scout."""

from prefect_robomaker.tasks.runtime.applications.scout.agent import make_agent

__all__ = ["make_agent"]
