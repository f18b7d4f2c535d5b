"""Inputs of a job: application bundles, data sources, the rooms of its world.

May import: `schemas`, `tasks.catalog`, `tasks.service`, `tasks.simulations.environment`, `tasks.storage`.
"""

__all__ = ["bundles", "colcon", "data_sources", "world_rooms"]
