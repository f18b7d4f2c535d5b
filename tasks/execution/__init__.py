"""Running a stored job exactly once: leases, claims, retry limits, slots, task pools, steps as Prefect tasks.

May import: `schemas`, `tasks.catalog`, `tasks.service`.
"""

__all__ = ["artifacts", "claims", "held_leases", "leases", "retry_limit", "slots", "steps", "task_pool"]
