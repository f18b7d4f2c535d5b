"""Reports as data: the report, its summary, comparison and history, the record of a run and its progress.

May import: `schemas` (exit codes, owners of jobs), `schemas.runs`, `schemas.wire`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "changes",
    "comparison",
    "consistency",
    "forecast",
    "history",
    "inputs",
    "kept_outputs",
    "progress",
    "report",
    "retention",
    "run_record",
    "run_states",
    "states",
    "summary",
    "variants",
]
