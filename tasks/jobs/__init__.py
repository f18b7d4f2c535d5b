"""Runs of stored jobs, side by side: simulation job, batch, world generation job, world export job, deployment job.

May import: `schemas`, `tasks.backends`, `tasks.catalog`, `tasks.execution`, `tasks.fleet`, `tasks.machine`,
`tasks.reporting`, `tasks.runtime.limits`, `tasks.runtime.supervision`, `tasks.service`, `tasks.simulations`,
`tasks.simulations.containers`, `tasks.simulations.environment`, `tasks.simulations.outputs`,
`tasks.simulations.planning`, `tasks.simulations.ros`, `tasks.worlds`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "batch_runs",
    "batch_workers",
    "deployment_artifacts",
    "deployment_runs",
    "export_runs",
    "generation_runs",
    "job_folders",
    "job_runs",
    "kept_outputs",
    "places",
    "world_jobs",
]
