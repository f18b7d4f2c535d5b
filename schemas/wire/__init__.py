"""Parts that all operations share: base classes, names, ARNs, ids, errors, and saying what is wrong with a request.

May import: `schemas` (exit codes).
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "arns",
    "base",
    "common",
    "deprecations",
    "errors",
    "globs",
    "ids",
    "job_configs",
    "json_values",
    "maintenance_windows",
    "operation_shape",
    "request_problems",
    "strict_json",
]
