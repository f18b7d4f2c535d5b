"""Applications that are container images: engines, command lines, outputs, cleanup.

May import: `schemas`, `tasks.catalog`, `tasks.runtime.agents`, `tasks.simulations.environment`,
`tasks.simulations.outputs`, `tasks.simulations.ros`.
"""

__all__ = ["cleanup", "engines", "outputs", "plans"]
