"""The requests and responses of the 57 operations, one module per resource, and the table of all operations.

May import: `schemas.runs`, `schemas.wire`, `schemas.worlds`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "applications",
    "deployment_jobs",
    "fleets",
    "registry",
    "resources",
    "robot_applications",
    "robots",
    "simulation_applications",
    "simulation_job_batches",
    "simulation_jobs",
    "tags",
    "world_export_jobs",
    "world_generation_jobs",
    "world_templates",
    "worlds",
]
