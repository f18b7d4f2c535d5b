"""From the request of a job to a run plan: applications, launch configurations, resumed runs.

May import: `schemas`, `tasks.catalog`, `tasks.runtime.states`, `tasks.service`, `tasks.simulations.containers`,
`tasks.simulations.environment`, `tasks.simulations.inputs`, `tasks.simulations.ros`.
"""

__all__ = ["applications", "job_contents", "resuming", "run_plans"]
