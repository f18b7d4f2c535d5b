"""Running stored jobs, each by one worker at a time, and telling Prefect of flow runs: ends, signs of life, deaths.

May import: `schemas`, `tasks.catalog`, `tasks.execution.mapping`, `tasks.service`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "artifacts",
    "batch_slots",
    "dead_flow_runs",
    "events",
    "flow_ends",
    "held_leases",
    "job_leases",
    "mapping",
    "one_worker_per_job",
    "orphans",
    "prefect_settings",
    "retry_limit",
    "run_watch",
    "schedule_overlaps",
    "task_pool",
    "task_runs",
]
