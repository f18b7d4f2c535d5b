"""Reports as data: the report, its summary, the record of a run and the progress of a running pipeline.

May import: `schemas.runs`, `schemas.wire`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["progress", "report", "run_record", "summary", "variants"]
