"""Specifications: YAML text, references and their types, every check before a run, and the JSON Schema.

May import: `schemas.operations`, `schemas.runs`, `schemas.templates`, `schemas.wire`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["batch_splitting", "check", "model", "probe_requests", "references", "resolving", "text", "world_counts"]
