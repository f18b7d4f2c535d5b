"""Environment of a run's programs: folders, variables, overlays of bundles, processors, memory, shared memory.

May import: `schemas`, `tasks.service`, `tasks.storage.roles`.
"""

__all__ = [
    "compute",
    "folders",
    "fresh_keys",
    "overlays",
    "process_variables",
    "role_access",
    "run_environment",
    "shared_memory",
]
