"""World generation and export jobs: the steps around WorldForge.

May import: `schemas`, `tasks.catalog`, `tasks.execution`, `tasks.service`, `tasks.simulations.inputs`,
`tasks.simulations.outputs`, `tasks.storage`, `tasks.worldforge`, `tasks.worldforge.bundle`,
`tasks.worldforge.exports`, `tasks.worldforge.pictures`.
"""

__all__ = ["archive_places", "builders", "bundles", "export", "generation", "keeping", "previews", "reuse"]
