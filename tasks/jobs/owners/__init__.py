"""Who carries out a job: orders for oneself, what they need of their environment, and how a job's owner stands.

May import: `schemas`, `tasks.catalog`, `tasks.execution`, `tasks.service`, `tasks.simulations.planning`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["job_standings", "needed_environments", "own_orders"]
