"""Storing a run's outputs: output locations, upload configurations, names, rolling uploads, publication.

May import: `schemas`, `tasks.catalog`, `tasks.runtime.supervision`, `tasks.service`, `tasks.simulations.environment`,
`tasks.storage`.
"""

__all__ = ["bounds", "output_places", "run_outputs", "upload_ends", "upload_files"]
