"""Running a stored job exactly once: leases, claims, retry limits, slots, task pools, and what Prefect shows of it.

May import: `schemas`, `tasks.catalog`, `tasks.service`.
"""

__all__ = ["artifacts", "claims", "held_leases", "leases", "retry_limit", "slots", "task_pool"]
