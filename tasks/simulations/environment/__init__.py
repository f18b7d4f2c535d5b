"""What the programs of a run find: folders, variables, overlays of bundles, processors, memory, shared memory.

May import: `schemas`, `tasks.service`.
"""

__all__ = ["compute", "folders", "overlays", "process_variables", "run_environment", "shared_memory"]
