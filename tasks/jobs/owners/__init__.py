"""Owners of jobs: orders for oneself, the environment that they need, and how a job's owner stands.

May import: `schemas`, `tasks.catalog`, `tasks.execution`, `tasks.service`, `tasks.simulations.planning`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["job_standings", "needed_environments", "own_orders"]
