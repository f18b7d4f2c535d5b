"""What the programs of a run find: folders, environment variables, processors, memory, shared memory.

May import: `schemas`, `tasks.service`.
"""

__all__ = ["compute", "folders", "process_variables", "run_environment", "shared_memory"]
