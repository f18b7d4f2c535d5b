"""Shared parts of robot applications and simulation applications: their handlers, their records, their versions.

May import: `schemas`, `tasks.catalog`, `tasks.operations`, `tasks.service`, `tasks.simulations.planning`.
"""

__all__ = ["handlers", "records"]
