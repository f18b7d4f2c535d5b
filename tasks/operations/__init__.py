"""Handlers of the 57 operations, one module per resource: check, store, answer; without Prefect. Steps have one more.

May import: `schemas`, `tasks.catalog`, `tasks.execution`, `tasks.fleet`, `tasks.jobs`, `tasks.machine`,
`tasks.operations.applications`, `tasks.service`, `tasks.simulations`, `tasks.simulations.environment`,
`tasks.simulations.inputs`, `tasks.simulations.outputs`, `tasks.simulations.planning`, `tasks.worldforge`,
`tasks.worldforge.bundle`, `tasks.worldforge.proofs`, `tasks.worlds`.
"""

__all__ = ["deployment_jobs", "pages", "registry", "step_operations"]
