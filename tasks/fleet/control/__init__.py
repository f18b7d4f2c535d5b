# pyright: reportUnsupportedDunderAll=false
"""Control over rollouts: pause, resume, approval, dry run, what follows at the threshold, and after a job's end.

May import: `schemas`, `tasks.catalog`, `tasks.fleet`, `tasks.fleet.rollout`, `tasks.service`.
"""

__all__ = ["decisions", "dry_runs", "requests", "rollbacks", "tending"]
