"""Resource limits of a run and their measurement: processes, disk, logs.

May import: `schemas`.
"""

__all__ = ["capped_logs", "disk_use", "disk_walk", "left_files", "limits", "logs", "processes", "run_notes"]
