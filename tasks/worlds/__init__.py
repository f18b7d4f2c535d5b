"""World generation and export jobs: the steps around WorldForge.

May import: `schemas`, `tasks.catalog`, `tasks.execution`, `tasks.service`, `tasks.simulations.inputs`,
`tasks.simulations.outputs`, `tasks.storage`, `tasks.worldforge`, `tasks.worldforge.exports`.
"""

__all__ = ["archive_places", "builders", "bundles", "export", "generation", "reuse"]
