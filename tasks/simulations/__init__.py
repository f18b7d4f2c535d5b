"""Simulation jobs and batches: from a stored request to stored outputs.

May import: `schemas`, `tasks.catalog`, `tasks.execution`, `tasks.runtime.limits`, `tasks.runtime.supervision`,
`tasks.service`, `.containers`, `.environment`, `.outputs`, `.planning`, `.ros`.
"""

__all__ = ["job_folders", "job_runs", "steps"]
