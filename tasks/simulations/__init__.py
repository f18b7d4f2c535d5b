"""Runs of simulation jobs: planning, inputs, containers, ROS, outputs; storing a job.

May import: `schemas`, `tasks.catalog`, `tasks.service`, `tasks.storage`, `.inputs`, `.outputs`, `.planning`.
"""

__all__ = ["reused_results", "stored_jobs"]
