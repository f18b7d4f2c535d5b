"""Running stored jobs, each by one worker at a time: leases, claims, retry limits, slots, task pools, steps.

May import: `schemas`, `tasks.catalog`, `tasks.service`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "artifacts",
    "claims",
    "events",
    "held_leases",
    "leases",
    "nights",
    "retry_limit",
    "slots",
    "steps",
    "task_pool",
]
